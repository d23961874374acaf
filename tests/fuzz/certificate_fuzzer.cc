#include <cstdint>
#include <string>

#include "server/api/certificate_to_proto.h"
#include "server/calibration/board.h"
#include "server/calibration/certificate.h"
#include "server/calibration/floor_points.h"
#include "server/calibration/wand.h"
#include "tests/fuzz/fuzz_check.h"

// A calibration's certificate, as the command line and as the daemon read it; and the short words that tell a
// board, a wand or a point on the floor.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace kinevox;
    const std::string text(data, data + size);
    const auto certificate = parse_certificate(text, "fuzz.json");
    FUZZ_CHECK(certificate.ok() || certificate.status().message().find('\n') == absl::string_view::npos);
    if (certificate.ok()) {
        (void)certificate_text(*certificate);
        FUZZ_CHECK(parse_certificate(certificate_json(*certificate), "again.json").ok());
    }
    (void)certificate_to_proto(text);
    if (const auto board = parse_board(text); !board.ok())
        FUZZ_CHECK(board.status().message().find('\n') == absl::string_view::npos);
    if (const auto wand = parse_wand(text); !wand.ok())
        FUZZ_CHECK(wand.status().message().find('\n') == absl::string_view::npos);
    Camera camera;
    camera.name = "left";
    camera.width = 64, camera.height = 48;
    (void)parse_floor_point(text, {camera});
    return 0;
}
