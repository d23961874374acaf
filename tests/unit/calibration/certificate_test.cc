// Certificates as JSON and back, and what hostile JSON gives.
#include "server/calibration/certificate.h"

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
    c.made_by = "wand", c.made_at = "2026-03-01 14:05";
    c.cameras = testing::ring(3);
    for (int i = 0; i < 3; ++i) {
        CameraQuality quality;
        quality.views = 40 + i, quality.fit_rms_px = 0.125, quality.coverage = 0.5;
        if (i != 1) quality.held_out_rms_px = 0.25;
        quality.coverage_counts.assign(Coverage::kColumns * Coverage::kRows, i);
        quality.misses = {{{100.5, 20}, {0.125, -0.25}}, {{7, 8}, {0, 3}}};
        c.quality.push_back(quality);
        IntrinsicsResult lens;
        lens.camera = c.cameras[i];
        lens.rms_px = 0.2, lens.used = 12, lens.std_deviations[0] = 0.5;
        lens.coverage_counts = quality.coverage_counts;
        c.lenses.push_back(lens);
    }
    c.fit_rms_px = 0.1, c.held_out_rms_px = 0.2;
    c.scale = ScaleError{-0.5, 1.5, 100};
    c.volume = VolumeCoverage{{-1, -1, 0}, {1, 1, 2}, 1, 0.75, 0.5};
    c.hull = HullAgreement{{0.75, std::nan(""), 0.5}, 0.625, 12};
    c.subject_height_m = 1.8;
    c.world_is_set = true;
    c.seen_points = {{0.5, 0.25, 1}, {-1, 0, 0.125}};
    c.floor = FloorQuality{"person", std::nullopt, 8.0, 0.25};
    c.pictures = {{"cam1", std::string("\x89PNG\0abc", 8)}};
    c.findings = {
        {Verdict::kCare, "coverage", "cam2", "camera cam2 is \"poorly\" covered", "hold the wand there"}};
    return c;
}

TEST(Certificate, ComesBackFromItsJson) {
    const std::string text = certificate_json(full());
    const auto back = parse_certificate(text, "c.json");
    ASSERT_TRUE(back.ok()) << back.status();
    // Rotations and pixels are rounded by what a text holds; the text of the text is the same.
    EXPECT_EQ(back->cameras[1].name, "cam2");
    EXPECT_LT(norm(back->cameras[1].centre_in_world() - full().cameras[1].centre_in_world()), 1e-9);
    EXPECT_EQ(back->verdict(), Verdict::kCare);
    EXPECT_EQ(back->pictures[0].png, full().pictures[0].png);
    EXPECT_FALSE(back->quality[1].held_out_rms_px.has_value());
    EXPECT_TRUE(std::isnan(back->hull->iou[1]));
    EXPECT_EQ(back->quality[0].misses[0].miss_px, (Vec2{0.125, -0.25}));
    const auto again = parse_certificate(certificate_json(*back), "c.json");
    ASSERT_TRUE(again.ok());
    EXPECT_EQ(certificate_json(*again).size(), certificate_json(*back).size());
    // One without anything is one, too.
    EXPECT_TRUE(parse_certificate(certificate_json({}), "c.json").ok());
}

TEST(Certificate, WhatIsNoneIsRefusedInOneLine) {
    const std::string good = certificate_json(full());
    std::vector<std::string> table{
        "", "{", "[]", "null", "{\"made_by\": 3}", "\"\xff\"", std::string(100000, '[')};
    for (std::size_t cut = 0; cut < good.size() - 2; cut += 97) table.push_back(good.substr(0, cut));
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
        EXPECT_THAT(std::string(certificate.status().message()), HasSubstr("c.json: is no certificate"));
        EXPECT_THAT(std::string(certificate.status().message()), Not(HasSubstr("\n")));
    }
}

}  // namespace
}  // namespace kinevox
