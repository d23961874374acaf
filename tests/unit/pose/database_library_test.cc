// The pose library, the aimed cameras, and what a built database holds.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <set>

#include "kernels/body_silhouette.h"
#include "server/pose/database/aimed_view.h"
#include "server/pose/database/silhouette_codec.h"
#include "tests/unit/pose/database_fixture.h"

namespace kinevox {
namespace {

TEST(PoseLibrary, CoversAllMovementsWithoutDuplicates) {
    const std::vector<LibraryPose> poses = library_poses(1400);
    ASSERT_EQ(poses.size(), 1400u);
    // The number of key poses of each movement: a table that loses rows is noticed.
    EXPECT_EQ(key_pose_count(), 637);
    const std::vector<LibraryPose> key_poses = library_poses(key_pose_count());
    for (const auto& [word, count] : {std::pair{"walk", 72},
                                      {"run", 60},
                                      {"sprint set", 6},
                                      {"sprint drive", 36},
                                      {"sprint push-off", 6},
                                      {"sprint on your marks", 2},
                                      {"squat", 36},
                                      {"jump", 13},
                                      {"arm", 374},
                                      {"balance", 48},
                                      {"lunge", 30},
                                      {"kick", 18},
                                      {"bent forward", 6}})
        EXPECT_EQ(std::ranges::count_if(
                      key_poses,
                      [&](const LibraryPose& pose) { return pose.label.find(word) != std::string::npos; }),
                  count)
            << word;
    for (const LibraryPose& pose : poses) {
        for (int dof = 0; dof < kBodyDofCount; ++dof) {
            ASSERT_TRUE(std::isfinite(pose.coordinates[dof])) << pose.label;
            if (dof >= kDofSacroiliac &&
                pose.label.find(" to ") ==
                    std::string::npos) {  // a blend of two within limits may leave them a little
                ASSERT_GE(pose.coordinates[dof], kBodyDofs[dof].lower - 1e-9)
                    << pose.label << " " << kBodyDofs[dof].name;
                ASSERT_LE(pose.coordinates[dof], kBodyDofs[dof].upper + 1e-9)
                    << pose.label << " " << kBodyDofs[dof].name;
            }
        }
        for (int dof : {0, 1, 2, kDofRootRotation + 2})
            ASSERT_NEAR(pose.coordinates[dof], 0, 0.5) << pose.label;
    }
    EXPECT_EQ(poses, library_poses(1400));
    EXPECT_EQ(library_poses(10).size(), 10u);
    std::set<std::string> keys;
    for (const LibraryPose& pose : library_poses(key_pose_count())) keys.insert(pose.label);
    EXPECT_EQ(static_cast<int>(keys.size()), key_pose_count()) << "labels of key poses are unique";
}

TEST(PoseLibrary, KeyPosesDiffer) {
    const BodyModel model(default_body_shape());
    std::vector<std::array<Vec3, kJointNames.size()>> joints;
    for (const LibraryPose& pose : library_poses(key_pose_count()))
        joints.push_back(model.forward(pose.coordinates).joints_in_world);
    double min_distance_m = 1;
    for (std::size_t a = 0; a < joints.size(); ++a)
        for (std::size_t b = a + 1; b < joints.size(); ++b) {
            double sum = 0;
            for (std::size_t j = 0; j < kJointNames.size(); ++j) sum += norm(joints[a][j] - joints[b][j]);
            min_distance_m = std::min(min_distance_m, sum / kJointNames.size());
        }
    EXPECT_GT(min_distance_m, 0.0101) << "measured 0.0116 m: two strides of walking";
}

TEST(PoseLibrary, PosesMatchLabels) {
    const BodyModel model(default_body_shape());
    const auto joints = [&](const std::string& label) {
        for (const LibraryPose& pose : library_poses(key_pose_count()))
            if (pose.label == label) return model.forward(pose.coordinates).joints_in_world;
        ADD_FAILURE() << "no pose " << label;
        return std::array<Vec3, kJointNames.size()>{};
    };
    enum {
        kRoot,
        kSacroiliac,
        kSkullbase,
        kTop,
        kShoulderL,
        kElbowL,
        kWristL,
        kHandL,
        kHipL,
        kKneeL,
        kAnkleL,
        kToeL
    };
    const auto up = joints("both arms up"), out = joints("both arms sideways"),
               set = joints("sprint set, hips up 10, left");
    EXPECT_GT(up[kWristL].z, up[kTop].z);
    EXPECT_NEAR(out[kWristL].z, out[kShoulderL].z, 0.1);
    EXPECT_GT(out[kWristL].y, 0.6);
    const auto squat = joints("squat 100 %, feet 16 deg, arms forward");
    EXPECT_LT(squat[kHipL].z - squat[kKneeL].z, 0.12);
    EXPECT_GT(squat[kWristL].x, 0.3);
    // Set position: hips above the shoulders or level, hands near the floor below the shoulders.
    EXPECT_GT(set[kHipL].z, set[kShoulderL].z - 0.15);
    EXPECT_LT(std::fabs(set[kHandL].x - set[kShoulderL].x), 0.2);
    EXPECT_NEAR(set[kHandL].z, std::min(set[kToeL].z, set[kToeL + 8].z), 0.15);
    const auto knee = joints("balance, knee up 100 %, arms out, left");
    EXPECT_GT(knee[kKneeL].z, knee[kHipL].z - 0.1);
}

TEST(PoseLibrary, MirrorsAndBlendsPoses) {
    const BodyModel model(default_body_shape());
    for (int n = 0; n < 20; ++n) {
        const BodyCoordinates q = unseen_pose(n), m = mirrored(q);
        const auto a = model.forward(q).joints_in_world, b = model.forward(m).joints_in_world;
        for (int joint = 4; joint < 12; ++joint) {
            EXPECT_NEAR(norm(a[joint] - Vec3{b[joint + 8].x, -b[joint + 8].y, b[joint + 8].z}), 0, 1e-9);
            EXPECT_NEAR(norm(b[joint] - Vec3{a[joint + 8].x, -a[joint + 8].y, a[joint + 8].z}), 0, 1e-9);
        }
        const BodyCoordinates other = unseen_pose(n + 50);
        EXPECT_LT(mean_joint_distance(model, blended(q, other, 0), q), 1e-9);
        EXPECT_LT(mean_joint_distance(model, blended(q, other, 1), other), 1e-6);
        const double half = mean_joint_distance(model, blended(q, other, 0.5), q);
        EXPECT_LT(half, mean_joint_distance(model, q, other) + 1e-9);
    }
}

TEST(AimedView, ShowsTargetAtMetricScale) {
    const Vec3 eye{3, -4, 2.5}, target{0.5, 0.2, 1};
    const AimedView view = aimed_view(eye, target, 1.2, 96);
    EXPECT_NEAR(view.distance_m, norm(eye - target), 1e-9);
    EXPECT_NEAR(view.azimuth, std::atan2(-4.2, 2.5), 1e-9);
    EXPECT_GT(view.elevation, 0.2);
    const auto pixel = [&](Vec3 p) {
        const auto& c = view.camera;
        double q[3];
        for (int r = 0; r < 3; ++r)
            q[r] = c.rotation_camera_from_world[3 * r] * p.x + c.rotation_camera_from_world[3 * r + 1] * p.y +
                   c.rotation_camera_from_world[3 * r + 2] * p.z + c.translation_camera_from_world[r];
        return Vec2{c.fx * q[0] / q[2] + c.cx, c.fy * q[1] / q[2] + c.cy};
    };
    EXPECT_NEAR(pixel(target).x, 47.5, 1e-3);
    EXPECT_NEAR(pixel(target).y, 47.5, 1e-3);
    EXPECT_NEAR(pixel(target + 0.5 * view.right).x, 47.5 + 0.5 / view.metres_per_px, 1e-3);
    EXPECT_NEAR(pixel(target + 0.5 * view.down).y, 47.5 + 0.5 / view.metres_per_px, 1e-3);
    EXPECT_LT(view.down.z, 0);
    const AimedView above =
        aimed_view({1, 1, 4}, {1, 1, 1}, 1.2, 64);  // straight down: no direction is better
    EXPECT_NEAR(above.elevation, std::numbers::pi / 2, 1e-9);
    EXPECT_NEAR(norm(above.right), 1, 1e-9);
}

TEST(AimedView, RectifiedSilhouetteEqualsAimedCamera) {
    const BodyModel model(default_body_shape());
    kernels::CameraModel camera = room_cameras()[1];
    camera.k1 = -0.2f, camera.k2 = 0.05f, camera.p1 = 0.001f;
    for (int n = 0; n < 6; ++n) {
        BodyCoordinates pose = unseen_pose(n);
        pose[0] = 1.2 * std::sin(n), pose[1] = -1.0 * std::cos(n), pose[2] = 0.95,
        pose[kDofRootRotation + 2] = n;
        const RenderedFrame frame = render_frame(model, pose, std::span(&camera, 1));
        const AimedView view = aimed_view(camera_centre(camera), frame.centre_in_world, 1.25, 96);
        AimedSilhouette aimed;
        rectify_silhouette(camera, frame.silhouettes[0].sharp.data(), frame.silhouettes[0].bounds, view,
                           aimed);
        const RenderedFrame direct = render_frame(model, pose, std::span(&view.camera, 1));
        int both = 0, either = 0;
        for (std::size_t k = 0; k < aimed.mask.size(); ++k) {
            both += aimed.mask[k] && direct.silhouettes[0].sharp[k];
            either += aimed.mask[k] || direct.silhouettes[0].sharp[k];
        }
        EXPECT_GT(both, 0.93 * either);
        EXPECT_FALSE(aimed.truncated);
    }
}

TEST(PoseDatabase, StoresSilhouettesAndMoments) {
    const PoseDatabase& database = room_database();
    EXPECT_EQ(database.entry_count(), 700 * 72);
    EXPECT_EQ(database.slabs.size(), database.viewpoints.size());
    const BodyModel model(database.shape);
    auto calculator =
        kernels::make_moment_calculator(kernels::Device::kCpu, {.order = database.options.order});
    std::vector<float> scale(database.values());
    kernels::moment_orthonormal_scale(database.options.order, scale.data());
    for (int pose = 0; pose < database.pose_count(); pose += 97) {
        for (int slab = 0; slab < static_cast<int>(database.slabs.size()); ++slab) {
            const int bin = pose % kernels::kViewBins;
            // Rendered again: a body at the origin, heading 0, a camera in that bin.
            const Vec3 middle = database.body_centres[pose];
            const double azimuth = -2 * std::numbers::pi * bin / kernels::kViewBins;
            const Viewpoint& from = database.viewpoints[slab];
            const Vec3 direction{std::cos(from.elevation) * std::cos(azimuth),
                                 std::cos(from.elevation) * std::sin(azimuth), std::sin(from.elevation)};
            const AimedView view =
                aimed_view(middle + direction / from.inverse_distance, middle, database.half_width_m(), 96);
            const RenderedFrame frame =
                render_frame(model, database.poses[pose].coordinates, std::span(&view.camera, 1));
            EXPECT_EQ(database.silhouette(slab, pose, bin), frame.silhouettes[0].sharp);
            const kernels::MomentView to_describe{
                frame.silhouettes[0].sharp.data(), 96, frame.silhouettes[0].bounds, {}, 48};
            std::vector<kernels::SilhouetteMoments> described;
            calculator->compute(std::span(&to_describe, 1), described);
            const std::int16_t* stored =
                database.slabs[slab].moments.data() +
                (static_cast<std::size_t>(pose) * kernels::kViewBins + bin) * database.values();
            for (int v = 0; v < database.values(); ++v)
                EXPECT_NEAR(database.moment_step * stored[v], described[0].values[v] * scale[v], 1e-4);
        }
    }
    EXPECT_TRUE(unpack_silhouette("nonsense", 96, 0).empty());
    EXPECT_TRUE(unpack_silhouette(database.slabs[0].silhouettes[0], 96, kernels::kViewBins).empty());
}

TEST(PoseDatabase, SameBitsWithAnyThreads) {
    PoseDatabaseOptions options = small_options(60);
    const PoseDatabase two = built(room_cameras(), options);
    options.threads = 1;
    const PoseDatabase one = built(room_cameras(), options);
    for (std::size_t slab = 0; slab < one.slabs.size(); ++slab) {
        EXPECT_EQ(one.slabs[slab].moments, two.slabs[slab].moments);
        EXPECT_EQ(one.slabs[slab].codes, two.slabs[slab].codes);
        EXPECT_EQ(one.slabs[slab].silhouettes, two.slabs[slab].silhouettes);
    }
    EXPECT_EQ(one.fingerprint, two.fingerprint);
}

TEST(PoseDatabase, ViewpointsCoverCameras) {
    for (const auto& cameras : {room_cameras(), lane_cameras()}) {
        const std::vector<Viewpoint> viewpoints = viewpoints_of(cameras, {});
        EXPECT_GE(viewpoints.size(), 2u);
        EXPECT_LE(viewpoints.size(), 12u);
        for (const Viewpoint& v : viewpoints) {
            EXPECT_GT(v.elevation, -0.1);
            EXPECT_LT(v.elevation, 1.0);
        }
    }
    EXPECT_FALSE(viewpoints_of(std::vector{room_cameras()[0]}, {}).empty());
}

}  // namespace
}  // namespace kinevox
