// Certificates as JSON and back, and malformed JSON.
#include "server/calibration/certificate/certificate.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "server/calibration/coverage.h"
#include "tests/unit/calibration/synthetic_views.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

Certificate full() {
    Certificate c;
    c.method = "extrinsics_wand", c.create_time = "2026-03-01 14:05";
    c.cameras = testing::ring(3);
    for (int i = 0; i < 3; ++i) {
        CameraReprojection quality;
        quality.views = 40 + i, quality.fit_rms_px = 0.125, quality.coverage = 0.5;
        if (i != 1) quality.held_out_rms_px = 0.25;
        quality.coverage_counts.assign(Coverage::kColumns * Coverage::kRows, i);
        quality.residuals = {{{100.5, 20}, {0.125, -0.25}}, {{7, 8}, {0, 3}}};
        c.reprojections.push_back(quality);
        IntrinsicsResult intrinsics;
        intrinsics.camera = c.cameras[i];
        intrinsics.rms_px = 0.2, intrinsics.used = 12, intrinsics.stds[0] = 0.5;
        intrinsics.coverage_counts = quality.coverage_counts;
        c.intrinsics.push_back(intrinsics);
    }
    c.fit_rms_px = 0.1, c.held_out_rms_px = 0.2;
    c.scale = ScaleError{-0.5, 1.5, 100};
    c.volume = VolumeCoverage{{-1, -1, 0}, {1, 1, 2}, 1, 0.75, 0.5};
    c.hull_iou = HullIou{{0.75, std::nan(""), 0.5}, 0.625, 12};
    c.stature_m = 1.8;
    c.world_defined = true;
    c.target_points = {{0.5, 0.25, 1}, {-1, 0, 0.125}};
    c.floor = FloorQuality{"person", std::nullopt, 8.0, 0.25};
    c.overlays = {{"cam1", std::string("\x89PNG\0abc", 8)}};
    c.findings = {
        {Verdict::kCaution, "coverage", "cam2", "camera cam2 is \"poorly\" covered", "hold the wand there"}};
    return c;
}

TEST(Certificate, SurvivesARoundTripThroughJson) {
    const std::string text = certificate_json(full());
    const auto back = parse_certificate(text, "c.json");
    ASSERT_TRUE(back.ok()) << back.status();
    // Numbers are rounded by the text; a second round trip changes nothing.
    EXPECT_EQ(back->cameras[1].name, "cam2");
    EXPECT_LT(norm(back->cameras[1].centre_in_world() - full().cameras[1].centre_in_world()), 1e-9);
    EXPECT_EQ(back->verdict(), Verdict::kCaution);
    EXPECT_EQ(back->overlays[0].png, full().overlays[0].png);
    EXPECT_FALSE(back->reprojections[1].held_out_rms_px.has_value());
    EXPECT_TRUE(std::isnan(back->hull_iou->iou[1]));
    EXPECT_EQ(back->reprojections[0].residuals[0].residual_px, (Vec2{0.125, -0.25}));
    const auto again = parse_certificate(certificate_json(*back), "c.json");
    ASSERT_TRUE(again.ok());
    EXPECT_EQ(certificate_json(*again).size(), certificate_json(*back).size());
    // An empty certificate is valid.
    EXPECT_TRUE(parse_certificate(certificate_json({}), "c.json").ok());
}

TEST(Certificate, RefusesMalformedJsonInOneLine) {
    const std::string good = certificate_json(full());
    std::vector<std::string> table{
        "", "{", "[]", "null", "{\"method\": 3}", "\"\xff\"", std::string(100000, '[')};
    for (std::size_t truncated = 0; truncated < good.size() - 2; truncated += 97)
        table.push_back(good.substr(0, truncated));
    for (const auto& [from, to] : {std::pair{"\"check\"", "\"cheque\""},
                                   {"\"views\": 40", "\"views\": \"many\""},
                                   {"\"cam1\": {", "\"../x\": {"},
                                   {"\"views\": 40", "\"views\": -40"},
                                   {"\"views\": 40", "\"views\": 4294967296"},
                                   {"\"views\": 40", "\"views\": 40e30"},
                                   {"\"coverage_counts\": [", "\"coverage_counts\": [1,"},
                                   {"\"rotation_vector\"", "\"rotation\""}}) {
        std::string text = good;
        table.push_back(text.replace(text.find(from), std::string(from).size(), to));
    }
    for (const std::string& text : table) {
        const auto certificate = parse_certificate(text, "c.json");
        ASSERT_FALSE(certificate.ok()) << text.substr(0, 200);
        EXPECT_THAT(std::string(certificate.status().message()),
                    HasSubstr("c.json: not a calibration certificate"));
        EXPECT_THAT(std::string(certificate.status().message()), Not(HasSubstr("\n")));
    }
}

TEST(Certificate, NamesTheNewKeyForAnOldOne) {
    std::string text = certificate_json(full());
    text.replace(text.find("\"method\""), 8, "\"made_by\"");
    const auto certificate = parse_certificate(text, "c.json");
    EXPECT_THAT(std::string(certificate.status().message()), HasSubstr("key 'made_by' is now 'method'"));
}

}  // namespace
}  // namespace kinevox
