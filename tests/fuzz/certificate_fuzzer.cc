#include <cstdint>
#include <string>

#include "server/api/to_proto.h"
#include "server/calibration/board/board.h"
#include "server/calibration/board/floor.h"
#include "server/calibration/certificate/certificate.h"
#include "server/calibration/wand/wand.h"
#include "tests/fuzz/fuzz_check.h"

// A certificate, as the command line and the daemon read it, and the text forms of a board, a wand and a
// floor point.
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
