// The fit of lengths and postures, on silhouettes rendered from the model.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/files.h"
#include "common/geometry.h"
#include "server/pose/body_fitter.h"
#include "server/pose/body_model.h"
#include "server/pose/pose_cost.h"
#include "tests/support/seen_body.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

constexpr double kRate_hz = 15;

// A person of that stature who moves arms and legs.
class Trial {
  public:
    // `arrange` may change each frame set's posture before it is seen.
    explicit Trial(double stature_m, int frames = 12,
                   const std::function<void(testing::SeenBody&, BodyCoordinates&)>& arrange = {}) {
        body_.model = std::make_shared<BodyModel>(default_body_shape(stature_m));
        for (int n = 0; n < frames; ++n) {
            BodyCoordinates q = body_.standing();
            q[kDofRootPosition + 2] *= stature_m / 1.75;
            const double phase = 2 * std::sin(0.5 * n);
            q[kDofHipL] += radians(10 * phase), q[kDofKneeL] += radians(10 + 5 * phase);
            q[kDofShoulderL] += radians(15 * phase), q[kDofElbowR] += radians(20 + 10 * phase);
            if (arrange) arrange(body_, q);
            PoseObservation seen;
            seen.time_ns = static_cast<std::int64_t>(1e9 * n / kRate_hz);
            seen.centre_in_world = {0, 0, 0.55 * stature_m};
            seen.views = body_.see(q);
            seen_.push_back(std::move(seen));
            coordinates_.push_back(q);
        }
    }
    PoseObservation& at(std::size_t frame) { return seen_[frame]; }
    absl::StatusOr<BodyFit> fit(const BodyFitOptions& options = {}) const {
        std::vector<const PoseObservation*> frames;
        for (const PoseObservation& seen : seen_) frames.push_back(&seen);
        return fit_body(body_.cameras, kRate_hz, frames, default_body_shape(), {}, options);
    }
    // From the true postures with another body and both feet pointed.
    std::optional<BodyFit> fit_pointed(const BodyShape& start, double ankle_deg) const {
        std::vector<ObservedPosture> posed;
        for (std::size_t n = 0; n < seen_.size(); ++n) {
            BodyCoordinates q = coordinates_[n];
            q[kDofAnkleL] = q[kDofAnkleR] = radians(ankle_deg);
            posed.push_back({&seen_[n], posture_from_coordinates(q)});
        }
        return fit_lengths(posed, start, false, {});
    }

  private:
    testing::SeenBody body_;
    std::vector<PoseObservation> seen_;
    std::vector<BodyCoordinates> coordinates_;
};

TEST(BodyFit, FindsStatureFarFromStart) {
    for (const double stature_m : {1.45, 2.05}) {
        const auto fit = Trial(stature_m).fit();
        ASSERT_TRUE(fit.ok()) << fit.status();
        EXPECT_NEAR(fit->shape.stature_m, stature_m, 0.02 * stature_m);
    }
}

// Stands on its lower foot, `raised_m` above the floor; nothing below `hidden_below_m` is in the silhouettes.
Trial standing_trial(double raised_m, double hidden_below_m) {
    return Trial(1.85, 16, [=](testing::SeenBody& body, BodyCoordinates& q) {
        std::vector<BodyCapsule> capsules;
        body.model->capsules(body.model->forward(q), capsules);
        q[kDofRootPosition + 2] += raised_m - lower_foot(capsules).height_m;
        body.hidden_below_m = hidden_below_m;
    });
}
double leg_m(const BodyShape& shape) {
    return shape[kThigh] + shape[kShank];
}

TEST(BodyFit, StandsOnFloorWhereSilhouettesLackFeet) {
    const auto fit = standing_trial(0, 0.16).fit();
    ASSERT_TRUE(fit.ok()) << fit.status();
    EXPECT_GT(fit->standing_m, 0);
    EXPECT_NEAR(fit->shape.stature_m, 1.85, 0.04);
    EXPECT_NEAR(leg_m(fit->shape), leg_m(default_body_shape(1.85)), 0.035);
}

// A pointed foot explains the end of a shank that is longer, and small feet stay inside the silhouettes.
TEST(BodyFit, StandsOnUsualFeetWhereSilhouettesLackShoes) {
    const BodyShape truth = default_body_shape(1.85);
    BodyShape start = truth;
    start[kThigh] -= 0.02, start[kShank] -= 0.06;
    const auto fit = standing_trial(0, 0.1).fit_pointed(start, -60);
    ASSERT_TRUE(fit);
    EXPECT_GT(fit->standing_m, 0);
    EXPECT_NEAR(fit->shape.stature_m, 1.85, 0.02);
    EXPECT_NEAR(leg_m(fit->shape), leg_m(truth), 0.02);
    EXPECT_NEAR(fit->shape[kAnkleToToe], truth[kAnkleToToe], 0.008);
}

TEST(BodyFit, DoesNotStretchLegsOnABox) {
    const auto fit = standing_trial(0.25, 0).fit();
    ASSERT_TRUE(fit.ok()) << fit.status();
    EXPECT_EQ(fit->standing_m, 0);
    EXPECT_NEAR(leg_m(fit->shape), leg_m(default_body_shape(1.85)), 0.03);
}

TEST(BodyFit, DoesNotUseFrameSetsThatContradict) {
    Trial trial(1.75);
    Trial child(1.1);
    for (const std::size_t n : {4, 8})  // two of four cameras see something else
        for (const std::size_t c : {0, 1}) trial.at(n).views[c] = child.at(n).views[c];
    const auto fit = trial.fit();
    ASSERT_TRUE(fit.ok()) << fit.status();
    EXPECT_LE(fit->frame_set_count, 10);
    EXPECT_NEAR(fit->shape.stature_m, 1.75, 0.03);
}

TEST(BodyFit, FindsLongHair) {
    BodyShape shape = default_body_shape(1.7);
    shape[kHairBack] = 0.07;
    const auto model = std::make_shared<BodyModel>(shape);
    const auto fit =
        Trial(1.7, 12, [&](testing::SeenBody& body, BodyCoordinates&) { body.model = model; }).fit();
    ASSERT_TRUE(fit.ok()) << fit.status();
    EXPECT_NEAR(fit->shape[kHairBack], 0.07, 0.015);
    EXPECT_NEAR(fit->shape[kHeadRadius], shape[kHeadRadius], 0.005);
}

TEST(BodyFit, AddsNoHair) {
    const auto fit = Trial(1.7).fit();
    ASSERT_TRUE(fit.ok()) << fit.status();
    EXPECT_LT(fit->shape[kHairBack], 0.015);
}

TEST(BodyShape, ReadsFilesWithoutLaterLengths) {
    const BodyShape shape = default_body_shape(1.8);
    std::string text = body_shape_toml(shape);
    for (const char* key :
         {"pelvis_back_m", "waist_back_m", "chest_back_m", "shoulder_rise_m", "hair_back_m"}) {
        const std::size_t at = text.find(key);
        ASSERT_NE(at, std::string::npos);
        text.erase(at, text.find('\n', at) + 1 - at);
    }
    const testing::TemporaryFolder folder;
    const std::filesystem::path file = folder.path() / "older_body.toml";
    ASSERT_TRUE(write_file_atomically(file, text).ok());
    const auto read = read_body_shape(file);
    ASSERT_TRUE(read.ok()) << read.status();
    for (int k = 0; k < kBodyLengthCount; ++k) EXPECT_NEAR(read->lengths_m[k], shape.lengths_m[k], 1e-6);
}

// The back's surface is as far behind the joints as the lengths say.
TEST(BodySurface, KeepsDistancesToBack) {
    BodyShape shape = default_body_shape();
    shape[kWaistBack] += 0.03;
    const BodyModel model(shape);
    const BodyCapsule& waist =
        *std::find_if(model.capsules_in_segments().begin(), model.capsules_in_segments().end(),
                      [](const BodyCapsule& c) { return c.segment == kThorax; });
    EXPECT_NEAR(waist.radius_a - waist.a[0], shape[kWaistBack], 1e-6);
}

}  // namespace
}  // namespace kinevox
