// Silhouettes that are not what they should be: what the pose stage says of each, while it follows a body and
// when it has to find one.
#include <gtest/gtest.h>

#include <algorithm>
#include <functional>

#include "server/pipeline/convert.h"
#include "server/pose/pose_stage.h"
#include "tests/support/seen_body.h"

namespace kinevox {
namespace {

using Silhouettes = std::vector<kernels::Silhouettes>;

// Keeps what `keep` says of each pixel.
void cut(kernels::Silhouettes& s, const std::function<bool(int x, int y)>& keep) {
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
    cut(s, [](int, int) { return false; });
}
void fill(kernels::Silhouettes& s) {
    std::ranges::fill(s.sharp, 255);
    cut(s, [](int, int) { return true; });
}
void remove(kernels::Silhouettes& s) {
    s = {};
}

struct Case {
    const char* name;
    std::function<void(Silhouettes&)> spoil;
    // Mean error of the joints told, while a body is followed and ten frame sets after it is first seen, m;
    // 0: no pose may be told. Fewer cameras than the rest of the room has tell less of where a limb is that
    // was never seen before.
    double following_m, finding_m;
};

const Case kCases[] = {
    {"as they should be", [](Silhouettes&) {}, 0.03, 0.03},
    {"one camera missing", [](Silhouettes& s) { remove(s[0]); }, 0.05, 0.2},
    {"two cameras missing", [](Silhouettes& s) { remove(s[0]), remove(s[1]); }, 0.15, 0.2},
    {"three cameras missing", [](Silhouettes& s) { remove(s[0]), remove(s[1]), remove(s[2]); }, 0, 0},
    {"one empty", [](Silhouettes& s) { clear(s[0]); }, 0.05, 0.2},
    {"all empty", [](Silhouettes& s) { std::ranges::for_each(s, clear); }, 0, 0},
    {"one full", [](Silhouettes& s) { fill(s[0]); }, 0.05, 0.2},
    {"all full", [](Silhouettes& s) { std::ranges::for_each(s, fill); }, 0, 0},
    {"one cut by the picture's left edge",
     [](Silhouettes& s) {
         const int middle = (s[0].bounds.x0 + s[0].bounds.x1) / 2;
         cut(s[0], [&](int x, int) { return x >= middle; });
     },
     0.15, 0.2},
};

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
        int told = 0;
        for (std::size_t j = 0; j < kJointNames.size(); ++j)
            if (pose->joints[j].measured())
                sum += norm(pose->joints[j].in_world - truth.joints_in_world[j]), ++told;
        EXPECT_GE(told, 12) << one.name << ", " << when;
        EXPECT_LT(sum / std::max(told, 1), max_error_m) << one.name << ", " << when;
    }

    testing::SeenBody scene_;
    std::vector<kernels::CameraModel> models_;
    std::optional<PoseStage> stage_;
    Silhouettes seen_;
    std::int64_t frame_ = 0;
};

TEST_P(OddSilhouettes, WhileABodyIsFollowed) {
    const Case& one = kCases[GetParam()];
    for (int n = 0; n < 5; ++n) ASSERT_TRUE(show([](Silhouettes&) {}));
    std::shared_ptr<BodyPose> pose;
    for (int n = 0; n < 15; ++n) pose = show(one.spoil);
    judge(one, one.following_m, pose, "following");
    for (int n = 0; n < 8; ++n) pose = show([](Silhouettes&) {});
    judge(one, kCases[0].following_m, pose, "afterwards");
}

TEST_P(OddSilhouettes, WhileABodyIsToBeFound) {
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
