#include <cstdint>
#include <string>

#include "common/calibration_file.h"
#include "tests/fuzz/check_cameras.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const auto cameras = kinevox::parse_calibration_toml(std::string(data, data + size), "fuzz.toml");
    if (cameras.ok()) kinevox::check_cameras(*cameras);
    FUZZ_CHECK(cameras.ok() || cameras.status().message().find('\n') == absl::string_view::npos);
    return 0;
}
