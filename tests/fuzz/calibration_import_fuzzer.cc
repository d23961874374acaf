#include <cstdint>
#include <string>

#include "common/calibration_file.h"
#include "tests/fuzz/check_cameras.h"

// XML begins with '<', YAML does not, Kalibr's has a camera_model; each text goes to the reader it looks
// like.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::string text(data, data + size);
    const auto cameras = text.starts_with("<") ? kinevox::parse_calibration_qualisys(text, "fuzz.qca.txt")
                         : text.find("camera_model") != std::string::npos
                             ? kinevox::parse_calibration_kalibr(text, "fuzz.yaml")
                             : kinevox::parse_calibration_opencv(text, "fuzz.yml");
    if (cameras.ok()) kinevox::check_cameras(*cameras);
    FUZZ_CHECK(cameras.ok() || cameras.status().message().find('\n') == absl::string_view::npos);
    return 0;
}
