#include "kernels/cpu/scene_lookup.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <random>
#include <vector>

#include "kernels/tests/capsule_body.h"

namespace kinevox::kernels::cpu {
namespace {

// A camera's image, background and votes, all random.
class RandomScene {
    static constexpr int kWidth = 200, kHeight = 150;

  public:
    RandomScene(int channels, unsigned seed) : random_(seed) {
        const float angle = static_cast<float>(seed),
                    from[3] = {3 * std::cos(angle), 3 * std::sin(angle), 1.5f}, at[3] = {0, 0, 0.5f};
        CameraModel camera = testing::camera_looking(from, at, kWidth, kHeight, 150);
        camera.k1 = 0.1f;
        camera.p1 = 0.01f;
        camera.p2 = -0.02f;
        view_.camera = make_projector(camera, "test");
        view_.channels = channels;
        view_.cells_per_row = (kWidth + kde::kCellPixels - 1) / kde::kCellPixels;
        view_.vote_columns = kWidth / kde::kVoteBlock_px;
        view_.image_stride = kWidth * channels;
        view_.sees = true;
        const float bounds[4] = {-0.5f, 0.4f, -0.6f, 0.5f};
        std::copy_n(bounds, 4, view_.bounds);
        for (int& gain : view_.inverse_gain) gain = 16000;
        reference_ = bytes(view_.cells_per_row * kHeight * channels * kde::kCellPixels, 95, 125);
        scale_ = bytes(static_cast<int>(reference_.size()), 5, 30);
        image_ = bytes(kWidth * kHeight * channels, 75, 130);
        for (int n = 0; n < view_.vote_columns * (kHeight / kde::kVoteBlock_px + 1) + kVotePadding; ++n)
            votes_.push_back(static_cast<std::int8_t>(uniform(-kde::kMaxVote, kde::kMaxVote)));
        view_.reference = reference_.data();
        view_.scale = scale_.data();
        view_.image = image_.data();
        view_.votes = votes_.data();
    }
    const kde::SceneView& view() const { return view_; }
    int uniform(int low, int high) { return std::uniform_int_distribution(low, high)(random_); }
    float coordinate(float low, float high) { return std::uniform_real_distribution(low, high)(random_); }

  private:
    std::vector<std::uint8_t> bytes(int count, int low, int high) {
        std::vector<std::uint8_t> out;
        for (int n = 0; n < count; ++n) out.push_back(static_cast<std::uint8_t>(uniform(low, high)));
        return out;
    }
    std::minstd_rand random_;
    kde::SceneView view_;
    std::vector<std::uint8_t> reference_, scale_, image_;
    std::vector<std::int8_t> votes_;
};

TEST(SceneLookup, FindsFloorLightsOfSinglePoints) {
    for (const int channels : {1, 3}) {
        RandomScene scene(channels, 7);
        const kde::EvidenceParameters parameters;
        int known = 0;
        for (int round = 0; round < 300; ++round) {
            FloorPoints points;
            for (int n = 0; n < kPointsPerLookup; ++n)
                points.x[n] = scene.coordinate(-3, 3), points.y[n] = scene.coordinate(-3, 3);
            float light[kPointsPerLookup];
            lights_of_floor(scene.view(), points, parameters, light);
            for (int n = 0; n < kPointsPerLookup; ++n) {
                const auto one = channels == 1 ? kde::light_of_floor<1> : kde::light_of_floor<3>;
                EXPECT_EQ(light[n], one(scene.view(), points.x[n], points.y[n], parameters));
                known += light[n] >= 0;
            }
        }
        EXPECT_GT(known, 50) << channels;
    }
}

TEST(SceneLookup, FindsSupportOfSingleSamples) {
    RandomScene scenes[] = {{3, 1}, {3, 2}, {3, 4}};
    std::vector<const kde::SceneView*> views;
    for (const RandomScene& scene : scenes) views.push_back(&scene.view());
    int known = 0;
    for (int round = 0; round < 2000; ++round) {
        kde::SupportRay ray{};
        for (int i = 0; i < 3; ++i) {
            ray.origin[i] = scenes[0].coordinate(-2, 2);
            ray.direction[i] = scenes[0].coordinate(-1, 1);
        }
        ray.near = 0.3f;
        ray.far = 15;
        for (std::size_t count = 1; count <= views.size(); ++count) {
            const std::span<const kde::SceneView* const> some(views.data(), count);
            const float support = support_of(ray, some);
            EXPECT_EQ(support, kde::support_of(ray, static_cast<int>(count),
                                               [&](int n) -> const kde::SceneView& { return *some[n]; }));
            known += support > kde::kNoSupport && support < kde::kMaxKnownSupport;
        }
    }
    EXPECT_GT(known, 500);
}

}  // namespace
}  // namespace kinevox::kernels::cpu
