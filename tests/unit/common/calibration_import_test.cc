// Calibrations of other programs: intact files are read completely, damaged ones are refused in one line.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <string>
#include <vector>

#include "common/calibration_file.h"
#include "common/files.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

using Parse = std::function<absl::StatusOr<std::vector<Camera>>(const std::string&, const std::string&)>;

struct Format {
    const char* seed;
    Parse parse;
};
const Format kFormats[] = {{"kalibr.yaml", parse_calibration_kalibr},
                           {"opencv.yml", parse_calibration_opencv},
                           {"qualisys.xml", parse_calibration_qualisys}};

std::string seed(const char* name) {
    return *read_file(std::string(KINEVOX_SOURCE_DIR) + "/tests/fuzz/seeds/calibration_import/" + name);
}

void expect_sound(const absl::StatusOr<std::vector<Camera>>& read, const std::string& text) {
    if (!read.ok()) {
        EXPECT_THAT(std::string(read.status().message()), HasSubstr("broken")) << text;
        EXPECT_THAT(std::string(read.status().message()), Not(HasSubstr("\n")));
        return;
    }
    EXPECT_FALSE(read->empty());
    for (const Camera& camera : *read) {
        EXPECT_GT(camera.fx, 0);
        EXPECT_GT(camera.width, 0);
        EXPECT_TRUE(std::isfinite(norm(camera.centre_in_world())));
        const Mat3 turned =
            camera.camera_from_world.rotation * camera.camera_from_world.rotation.transposed();
        for (int i = 0; i < 9; ++i) EXPECT_NEAR(turned.m[i], i % 4 == 0, 1e-6);
    }
}

TEST(CalibrationImport, ReportsBrokenFilesInOneLine) {
    for (const Format& format : kFormats) {
        SCOPED_TRACE(format.seed);
        const std::string good = seed(format.seed);
        ASSERT_TRUE(format.parse(good, "broken").ok()) << format.parse(good, "broken").status();
        for (std::size_t cut = 0; cut < good.size(); cut += 5)
            expect_sound(format.parse(good.substr(0, cut), "broken"), good.substr(0, cut));
        // Removes or doubles each line; replaces each digit by a letter.
        for (std::size_t from = 0; from < good.size();) {
            const std::size_t end = std::min(good.find('\n', from), good.size() - 1) + 1;
            expect_sound(format.parse(good.substr(0, from) + good.substr(end), "broken"), "without a line");
            expect_sound(format.parse(good.substr(0, end) + good.substr(from), "broken"),
                         "with a line twice");
            from = end;
        }
        for (const char* other : {"nan", "-", "1e999", "\"", "<", "{", "\xff", "99999999999"})
            for (std::size_t i = 0; i < good.size(); i += 3)
                if (std::isdigit(static_cast<unsigned char>(good[i])))
                    expect_sound(format.parse(good.substr(0, i) + other + good.substr(i + 1), "broken"),
                                 other);
    }
}

TEST(CalibrationImport, RefusesOtherDistortionModels) {
    const std::string good = seed("kalibr.yaml");
    for (const auto& [from, to] :
         {std::pair{"pinhole", "omni"}, {"pinhole", "ds"}, {"radtan", "equidistant"}}) {
        std::string text = good;
        text.replace(text.find(from), std::string(from).size(), to);
        const auto read = parse_calibration_kalibr(text, "broken");
        ASSERT_FALSE(read.ok()) << to;
        EXPECT_THAT(std::string(read.status().message()), HasSubstr(to));
    }
}

}  // namespace
}  // namespace kinevox
