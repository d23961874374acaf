#include <cstdint>
#include <string>

#include "common/session_file.h"
#include "tests/fuzz/fuzz_check.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const auto session =
        kinevox::parse_session_toml(std::string(data, data + size), "/trial", "fuzz.toml", false);
    FUZZ_CHECK(session.ok() || session.status().message().find('\n') == absl::string_view::npos);
    if (!session.ok()) return 0;
    FUZZ_CHECK(session->fps > 0 && session->fps < 1e6);
    FUZZ_CHECK(!session->cameras.empty());
    FUZZ_CHECK(session->calibration.is_absolute());
    for (const kinevox::SessionCamera& camera : session->cameras) FUZZ_CHECK(camera.video.is_absolute());
    return 0;
}
