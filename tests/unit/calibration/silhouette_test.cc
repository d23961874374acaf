// Calibration quality and refinement from silhouettes.
#include <gtest/gtest.h>

#include "common/geometry.h"
#include "server/calibration/multi_view.h"
#include "server/calibration/person/person_extrinsics.h"
#include "server/calibration/person/silhouette_hull.h"
#include "server/calibration/person/silhouette_refine.h"
#include "server/cameras/studio/staging.h"
#include "tests/unit/calibration/studio_silhouettes.h"

namespace kinevox {
namespace {

double rotation_deg(const Camera& a, const Camera& b) {
    return degrees(angle_between(a.camera_from_world.rotation, b.camera_from_world.rotation));
}

TEST(HullIou, DropsForEveryWrongCameraOnly) {
    const auto seen = testing::studio_silhouettes("walk", 4, 8, 9);
    const double right = hull_iou(seen.cameras, seen.set).mean_iou;
    EXPECT_GT(right, 0.985);
    double before = right;
    for (const double angle_deg : {0.5, 1.0, 2.0}) {
        auto cameras = seen.cameras;
        cameras[1] = studio::bumped_camera(cameras[1], {0, radians(angle_deg), 0}, {});
        const double now = hull_iou(cameras, seen.set).mean_iou;
        EXPECT_LT(now, before - 0.01) << angle_deg;
        before = now;
    }
    // Scale and world frame are free.
    auto larger = seen.cameras;
    move_cameras({1.2, {rotation_z(0.3), {1, 2, 0.1}}}, larger);
    EXPECT_NEAR(hull_iou(larger, seen.set).mean_iou, right, 0.01);
}

TEST(HullIou, CountsEvaluatedFrameSets) {
    auto seen = testing::studio_silhouettes("walk", 4, 4, 9);
    for (auto& image : seen.set.frame_sets[0]) image = {};
    for (auto& frame_set : seen.set.frame_sets) frame_set[2].truncated = true;
    const HullIou hull = hull_iou(seen.cameras, seen.set);
    EXPECT_EQ(hull.frames, 3);
    EXPECT_TRUE(std::isnan(hull.iou[2]));
    EXPECT_GT(hull.iou[0], 0.98);
}

TEST(SilhouetteRefine, RestoresBumpedCameras) {
    const auto seen = testing::studio_silhouettes("walk", 4, 24, 5);
    auto wrong = seen.cameras;
    wrong[0] = studio::bumped_camera(wrong[0], {0.004, 0.012, -0.006}, {0.02, 0, 0.01});
    wrong[2] = studio::bumped_camera(wrong[2], {-0.008, 0.004, 0.01}, {0, 0.015, -0.02});
    SilhouetteRefineOptions options;
    options.prior_angle_deg = 5, options.prior_shift_m = 0.35;
    const auto refined = refine_from_silhouettes(wrong, seen.set, options);
    ASSERT_TRUE(refined.ok()) << refined.status();
    EXPECT_LT(refined->residual_after_px, 0.5 * refined->residual_before_px);
    auto solved = refined->cameras;
    align_to(seen.cameras, solved);
    for (std::size_t c = 0; c < solved.size(); ++c) {
        EXPECT_LT(norm(solved[c].centre_in_world() - seen.cameras[c].centre_in_world()), 0.02) << c;
        EXPECT_LT(rotation_deg(solved[c], seen.cameras[c]), 0.25) << c;
    }
}

PersonExtrinsicsOptions few_frame_sets() {
    PersonExtrinsicsOptions options;
    options.height_m = 1.8;
    options.first_frame_sets = 12, options.max_frame_sets = 14;
    return options;
}

TEST(PersonExtrinsics, SolvesPosesWithoutInitialGuess) {
    auto seen = testing::studio_silhouettes("walk", 4, 26, 7);
    auto intrinsics = seen.cameras;
    for (Camera& camera : intrinsics) camera.camera_from_world = {};
    const auto solved = extrinsics_from_person(intrinsics, seen.set, few_frame_sets());
    ASSERT_TRUE(solved.ok()) << solved.status();
    ASSERT_EQ(solved->cameras.size(), 4u);
    EXPECT_EQ(worst(solved->findings), Verdict::kGo);
    EXPECT_GT(solved->walked_wide_m, 1.5);
    std::vector<Vec3> from, to;
    for (std::size_t c = 0; c < 4; ++c) {
        EXPECT_GT(solved->cameras[c].centre_in_world().z, 0.5);
        from.push_back(solved->cameras[c].centre_in_world());
        to.push_back(seen.cameras[c].centre_in_world());
    }
    const SimilarityTransform alignment = *align_points(from, to, true);
    EXPECT_NEAR(alignment.scale, 1, 0.02);
    EXPECT_LT(norm(alignment.target_from_source.rotation * Vec3{0, 0, 1} - Vec3{0, 0, 1}), radians(1.0));
    auto cameras = solved->cameras;
    move_cameras(alignment, cameras);
    for (std::size_t c = 0; c < 4; ++c) {
        EXPECT_LT(norm(cameras[c].centre_in_world() - to[c]), 0.03) << c;
        EXPECT_LT(rotation_deg(cameras[c], seen.cameras[c]), 0.5) << c;
    }
}

TEST(PersonExtrinsics, NamesCameraWithoutSharedViews) {
    auto seen = testing::studio_silhouettes("walk", 4, 26, 7);
    for (auto& frame_set : seen.set.frame_sets) frame_set[3] = {};
    const auto solved = extrinsics_from_person(seen.cameras, seen.set, few_frame_sets());
    ASSERT_TRUE(solved.ok()) << solved.status();
    EXPECT_EQ(solved->excluded_cameras, std::vector<std::string>{"cam4"});
    EXPECT_EQ(worst(solved->findings), Verdict::kNoGo);
}

TEST(PersonExtrinsics, ReportsInsufficientMovement) {
    auto seen = testing::studio_silhouettes("arm_raise", 4, 14, 2);
    const auto solved = extrinsics_from_person(seen.cameras, seen.set, few_frame_sets());
    if (solved.ok()) {
        bool said = false;
        for (const Finding& finding : solved->findings)
            said = said || finding.check == "insufficient_movement";
        EXPECT_TRUE(said);
        EXPECT_NE(worst(solved->findings), Verdict::kGo);
    } else {
        EXPECT_TRUE(absl::IsFailedPrecondition(solved.status())) << solved.status();
    }
    for (auto& frame_set : seen.set.frame_sets)
        for (std::size_t c = 1; c < 4; ++c) frame_set[c] = {};
    const auto alone = extrinsics_from_person(seen.cameras, seen.set, few_frame_sets());
    EXPECT_TRUE(absl::IsFailedPrecondition(alone.status()));
    EXPECT_NE(std::string(alone.status().message()).find("walk"), std::string::npos);
}

}  // namespace
}  // namespace kinevox
