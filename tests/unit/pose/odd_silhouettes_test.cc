// Degraded silhouettes: the pose stage while tracking a body and while finding one.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <string>

#include "server/pipeline/convert.h"
#include "server/pose/pose_stage.h"
#include "tests/support/seen_body.h"

namespace kinevox {
namespace {

using Silhouettes = std::vector<kernels::Silhouettes>;

// Keeps the pixels for which `keep` is true.
void keep_pixels(kernels::Silhouettes& s, const std::function<bool(int x, int y)>& keep) {
    s.sharp_pixels = 0;
    s.bounds = {s.width, s.height, 0, 0};
    for (int y = 0; y < s.height; ++y)
        for (int x = 0; x < s.width; ++x) {
            std::uint8_t& pixel = s.sharp[static_cast<std::size_t>(y) * s.width + x];
            if (!keep(x, y)) pixel = 0;
            if (pixel == 0) continue;
            ++s.sharp_pixels;
            s.bounds = {std::min(s.bounds.x0, x), std::min(s.bounds.y0, y), std::max(s.bounds.x1, x + 1),
                        std::max(s.bounds.y1, y + 1)};
        }
    if (s.sharp_pixels == 0) s.bounds = {};
}
void clear(kernels::Silhouettes& s) {
    keep_pixels(s, [](int, int) { return false; });
}
void fill(kernels::Silhouettes& s) {
    std::ranges::fill(s.sharp, 255);
    keep_pixels(s, [](int, int) { return true; });
}
void remove(kernels::Silhouettes& s) {
    s = {};
}

struct Case {
    const char* name;
    std::function<void(Silhouettes&)> spoil;
    // Bounds of the mean joint error while tracking and ten frame sets after initialisation, m: the measured
    // values (printed as properties) plus 15 %. 0: no pose must be reported.
    double tracking_m, finding_m;
};

const Case kCases[] = {
    {"intact", [](Silhouettes&) {}, 0.0041, 0.0042},
    {"one camera missing", [](Silhouettes& s) { remove(s[0]); }, 0.0063, 0.0061},
    {"two cameras missing", [](Silhouettes& s) { remove(s[0]), remove(s[1]); }, 0.0085, 0.0088},
    {"three cameras missing", [](Silhouettes& s) { remove(s[0]), remove(s[1]), remove(s[2]); }, 0, 0},
    {"one empty", [](Silhouettes& s) { clear(s[0]); }, 0.0063, 0.0061},
    {"all empty", [](Silhouettes& s) { std::ranges::for_each(s, clear); }, 0, 0},
    {"one full", [](Silhouettes& s) { fill(s[0]); }, 0.0063, 0.0061},
    {"all full", [](Silhouettes& s) { std::ranges::for_each(s, fill); }, 0, 0},
    {"one truncated at the left",
     [](Silhouettes& s) {
         const int centre = (s[0].bounds.x0 + s[0].bounds.x1) / 2;
         keep_pixels(s[0], [&](int x, int) { return x >= centre; });
     },
     0.0050, 0.0041},
};
// Mean joint error some frame sets after the silhouettes are intact again, m; as above.
constexpr double kRecovered_m = 0.0042;

class OddSilhouettes : public ::testing::TestWithParam<int> {
  protected:
    OddSilhouettes() {
        PoseStageOptions options;
        options.body = scene_.model->shape();
        options.filtered = false;
        stage_.emplace(scene_.cameras, 30, options);
        for (const Camera& camera : scene_.cameras) models_.push_back(to_kernel(camera));
        std::vector<BodyCapsule> capsules;
        scene_.model->capsules(scene_.model->forward(scene_.standing()), capsules);
        for (const Camera& camera : scene_.cameras) seen_.push_back(testing::silhouette_of(camera, capsules));
    }

    std::shared_ptr<BodyPose> show(const std::function<void(Silhouettes&)>& spoil) {
        Silhouettes silhouettes = seen_;
        spoil(silhouettes);
        std::vector<PoseView> views;
        for (std::size_t c = 0; c < silhouettes.size(); ++c)
            views.push_back({&models_[c], silhouettes[c].width > 0 ? &silhouettes[c] : nullptr});
        const std::int64_t time_ns = 33'333'333LL * frame_;
        return stage_->process(1, frame_++, time_ns, views, {}, {}, {0, 0, 0.95});
    }

    void judge(const Case& one, double max_error_m, const std::shared_ptr<BodyPose>& pose, const char* when) {
        if (max_error_m == 0) {
            EXPECT_FALSE(pose) << one.name << ", " << when << ": nothing determines a pose";
            return;
        }
        ASSERT_TRUE(pose) << one.name << ", " << when;
        const PosedBody truth = scene_.model->forward(posture_from_coordinates(scene_.standing()));
        double sum = 0;
        int measured = 0;
        for (std::size_t j = 0; j < kJointNames.size(); ++j)
            if (pose->joints[j].measured())
                sum += norm(pose->joints[j].in_world - truth.joints_in_world[j]), ++measured;
        ASSERT_EQ(measured, static_cast<int>(kJointNames.size())) << one.name << ", " << when;
        const double error_m = sum / measured;
        RecordProperty(std::string(when) + "_error_m", std::to_string(error_m));
        EXPECT_LT(error_m, max_error_m) << one.name << ", " << when;
    }

    testing::SeenBody scene_;
    std::vector<kernels::CameraModel> models_;
    std::optional<PoseStage> stage_;
    Silhouettes seen_;
    std::int64_t frame_ = 0;
};

TEST_P(OddSilhouettes, DisturbTrackingLittle) {
    const Case& one = kCases[GetParam()];
    for (int n = 0; n < 5; ++n) ASSERT_TRUE(show([](Silhouettes&) {}));
    std::shared_ptr<BodyPose> pose;
    for (int n = 0; n < 15; ++n) pose = show(one.spoil);
    judge(one, one.tracking_m, pose, "tracking");
    for (int n = 0; n < 8; ++n) pose = show([](Silhouettes&) {});
    judge(one, kRecovered_m, pose, "recovered");
}

TEST_P(OddSilhouettes, DisturbInitialisationLittle) {
    const Case& one = kCases[GetParam()];
    std::shared_ptr<BodyPose> pose;
    for (int n = 0; n < 10; ++n) pose = show(one.spoil);
    judge(one, one.finding_m, pose, "finding");
}

INSTANTIATE_TEST_SUITE_P(All, OddSilhouettes, ::testing::Range(0, static_cast<int>(std::size(kCases))),
                         [](const auto& info) {
                             std::string name = kCases[info.param].name;
                             std::erase_if(
                                 name, [](char c) { return !std::isalnum(static_cast<unsigned char>(c)); });
                             return name;
                         });

}  // namespace
}  // namespace kinevox
