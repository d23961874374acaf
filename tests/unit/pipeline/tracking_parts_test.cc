#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/pipeline/tracking/blobs.h"
#include "server/pipeline/tracking/cone_box.h"
#include "server/pipeline/tracking/subject_centre.h"
#include "tests/unit/pipeline/scene.h"

namespace kinevox {
namespace {

using testing::camera_at;
using testing::four_cameras;

Ray ray_to(Vec3 eye, Vec3 target) {
    return {eye, normalized(target - eye)};
}

RayCandidate candidate(int camera, const Ray& ray) {
    return {camera, ray, 10000, 1 / 500.0, false};
}

TEST(RayIntersection, FindsPointOfExactRays) {
    const Vec3 g{0.3, -0.4, 0.95};
    std::vector<RayCandidate> rays;
    const std::vector<Camera> cameras = four_cameras();
    for (int c = 0; c < 4; ++c) rays.push_back(candidate(c, ray_to(cameras[c].centre_in_world(), g)));
    const auto meeting = intersect_rays(rays, 4);
    ASSERT_TRUE(meeting);
    EXPECT_LT(norm(meeting->point_in_world - g), 1e-9);
    EXPECT_EQ(meeting->inlier_count, 4);
}

TEST(RayIntersection, ExcludesOutlierRay) {
    const Vec3 g{0.3, -0.4, 0.95};
    const std::vector<Camera> cameras = four_cameras();
    for (int wrong = 0; wrong < 4; ++wrong) {
        std::vector<RayCandidate> rays;
        for (int c = 0; c < 4; ++c) {
            const Vec3 eye = cameras[c].centre_in_world();
            const Vec3 sideways = 0.7 * normalized(cross(g - eye, {0, 0, 1}));
            rays.push_back(candidate(c, ray_to(eye, c == wrong ? g + sideways : g)));
        }
        const auto meeting = intersect_rays(rays, 4);
        ASSERT_TRUE(meeting);
        EXPECT_LT(norm(meeting->point_in_world - g), 1e-9) << "camera " << wrong;
        EXPECT_EQ(meeting->chosen[wrong], -1);
        EXPECT_EQ(meeting->inlier_count, 3);
    }
}

TEST(RayIntersection, ChoosesCandidatesOfOneObject) {
    // Two people; each camera lists the wrong one first.
    const Vec3 subject{0.3, -0.4, 0.95}, decoys[4] = {{2, 1, 1}, {-1, 2, 1}, {1.5, -2, 1}, {-2, -1.5, 1}};
    const std::vector<Camera> cameras = four_cameras();
    std::vector<RayCandidate> rays;
    for (int c = 0; c < 4; ++c) {
        rays.push_back(candidate(c, ray_to(cameras[c].centre_in_world(), decoys[c])));
        rays.push_back(candidate(c, ray_to(cameras[c].centre_in_world(), subject)));
    }
    const auto meeting = intersect_rays(rays, 4);
    ASSERT_TRUE(meeting);
    EXPECT_LT(norm(meeting->point_in_world - subject), 1e-9);
    EXPECT_THAT(meeting->chosen, ::testing::ElementsAre(1, 3, 5, 7));
}

TEST(RayIntersection, IsEmptyForSkewRays) {
    EXPECT_FALSE(intersect_rays({}, 4));
    EXPECT_FALSE(intersect_rays({candidate(0, {{0, 0, 0}, {1, 0, 0}})}, 4));
    // One above the other, 1 m apart.
    EXPECT_FALSE(
        intersect_rays({candidate(0, {{-4, 0, 0}, {1, 0, 0}}), candidate(1, {{0, -4, 1}, {0, 1, 0}})}, 2));
    // They meet behind one of the cameras.
    EXPECT_FALSE(
        intersect_rays({candidate(0, {{-4, 0, 0}, {-1, 0, 0}}), candidate(1, {{0, -4, 0}, {0, 1, 0}})}, 2));
}

TEST(CentreFilter, FollowsSteadyRunWithoutLag) {
    CentreFilter filter;
    const Mat3 covariance{{4e-4, 0, 0, 0, 4e-4, 0, 0, 0, 4e-4}};
    const Vec3 velocity{8, 0.2, 0};
    filter.start({}, covariance);
    for (int n = 1; n <= 30; ++n) {
        filter.predict(1 / 30.0);
        if (n > 10) {
            EXPECT_LT(norm(filter.centre_in_world() - (n / 30.0) * velocity), 0.05);
        }
        filter.correct((n / 30.0) * velocity, covariance);
    }
    EXPECT_LT(norm(filter.velocity_in_world() - velocity), 0.2);
    EXPECT_LT(filter.centre_std_m(), 0.02);
}

TEST(Blobs, JoinsAcrossNarrowGapsOnly) {
    kernels::Silhouettes s;
    s.width = 637, s.height = 480;  // not a multiple of the word
    s.loose.assign(static_cast<std::size_t>(s.width) * s.height, 0);
    const auto fill = [&](int x0, int y0, int x1, int y1) {
        for (int y = y0; y < y1; ++y)
            for (int x = x0; x < x1; ++x) s.loose[static_cast<std::size_t>(y) * s.width + x] = 255;
    };
    fill(100, 100, 140, 180);
    fill(100, 183, 140, 263);  // 3 px below: the same person
    fill(500, 300, 530, 360);  // another
    fill(620, 470, 637, 480);  // in the corner
    fill(300, 10, 303, 13);    // a speck
    s.sharp = s.probability = s.loose;
    s.bounds = {100, 10, 637, 480};
    const std::vector<Blob> blobs = find_blobs(s, 50, 8);
    ASSERT_EQ(blobs.size(), 3u);
    EXPECT_EQ(blobs[0].sharp_pixels, 40 * 160);
    EXPECT_EQ(blobs[0].bounds, (kernels::Rect{100, 100, 140, 263}));
    EXPECT_NEAR(blobs[0].centroid_x, 119.5, 1.5);
    EXPECT_NEAR(blobs[0].centroid_y, 181.0, 2.0);
    EXPECT_FALSE(blobs[0].at_border);
    EXPECT_EQ(blobs[1].sharp_pixels, 30 * 60);
    EXPECT_EQ(blobs[2].sharp_pixels, 17 * 10);
    EXPECT_TRUE(blobs[2].at_border);
    EXPECT_EQ(merged(blobs).sharp_pixels, 40 * 160 + 30 * 60 + 17 * 10);
}

TEST(Blobs, WeighsTrunkMoreThanLegs) {
    kernels::Silhouettes s;
    s.width = s.height = 200;
    s.loose.assign(40000, 0);
    // Trunk 40 px wide and 60 tall; two legs 14 px wide and 80 tall. Round sections: areas as the squares of
    // widths.
    for (int y = 20; y < 160; ++y)
        for (int x = 60; x < 140; ++x) {
            const bool trunk = y < 80 && x >= 80 && x < 120;
            const bool leg = y >= 80 && ((x >= 82 && x < 96) || (x >= 104 && x < 118));
            if (trunk || leg) s.loose[y * 200 + x] = 255;
        }
    s.sharp = s.loose;
    s.bounds = {60, 20, 140, 160};
    const double trunk = 40.0 * 40 * 60, legs = 2 * 14.0 * 14 * 80;
    const double solid = (trunk * 49.5 + legs * 119.5) / (trunk + legs);
    const double flat = (2400 * 49.5 + 2240 * 119.5) / (2400 + 2240);
    ASSERT_GT(flat - solid, 15);
    const std::vector<Blob> blobs = find_blobs(s, 50, 8);
    ASSERT_EQ(blobs.size(), 1u);
    EXPECT_NEAR(blobs[0].centroid_y, solid, 4);
}

TEST(ConeBox, EnclosesBodyTightly) {
    const std::vector<Camera> cameras = four_cameras();
    const Vec3 at{0.5, -0.3, 0.9};
    const auto body = testing::body_at(at);
    std::vector<SilhouetteCone> cones;
    for (const Camera& camera : cameras)
        cones.push_back({&camera, testing::silhouettes_of(camera, body).bounds});
    const Box3 within{at - Vec3{2, 2, 2}, at + Vec3{2, 2, 2}};
    const auto box = box_of_cones(cones, within);
    ASSERT_TRUE(box);
    // The body spans 0.44 x 0.32 x 1.7 m.
    EXPECT_LE(box->min_in_world.x, at.x - 0.22);
    EXPECT_LE(box->min_in_world.y, at.y - 0.16);
    EXPECT_LE(box->min_in_world.z, at.z - 0.85);
    EXPECT_GE(box->max_in_world.x, at.x + 0.22);
    EXPECT_GE(box->max_in_world.y, at.y + 0.16);
    EXPECT_GE(box->max_in_world.z, at.z + 0.85);
    EXPECT_LT(box->max_in_world.x - box->min_in_world.x, 0.85);
    EXPECT_LT(box->max_in_world.y - box->min_in_world.y, 0.85);
    EXPECT_LT(box->max_in_world.z - box->min_in_world.z, 2.1);
}

TEST(ConeBox, IsEmptyWithoutIntersection) {
    const std::vector<Camera> cameras = four_cameras();
    const Vec3 here{0.5, 0, 1}, there{-1.5, 0.5, 1};
    const Box3 within{{-3, -3, 0}, {3, 3, 2}};
    EXPECT_FALSE(
        box_of_cones({{&cameras[0], testing::silhouettes_of(cameras[0], testing::body_at(here)).bounds},
                      {&cameras[1], testing::silhouettes_of(cameras[1], testing::body_at(there)).bounds},
                      {&cameras[2], testing::silhouettes_of(cameras[2], testing::body_at(there)).bounds}},
                     within));
}

TEST(ConeBox, AlignsSuccessiveLattices) {
    const Box3 one{{0.013, -0.51, -0.02}, {0.61, 0.12, 1.83}};
    const Box3 two{{0.113, -0.47, -0.01}, {0.71, 0.16, 1.84}};
    const kernels::Lattice a = lattice_over(one, 0.01, 3, {0.3, -0.2, 0.9});
    const kernels::Lattice b = lattice_over(two, 0.01, 3, {0.4, -0.2, 0.9});
    for (int axis = 0; axis < 3; ++axis) {
        EXPECT_EQ(a.size[axis] % 8, 0);
        const double bricks = (b.origin[axis] - a.origin[axis]) / 0.08;
        EXPECT_NEAR(bricks, std::round(bricks), 1e-4);
    }
    EXPECT_LE(a.origin[0], 0.013f);
    EXPECT_GE(a.origin[2] + 0.01f * a.size[2], 1.83f);
    // Too long a side is cut around the centre.
    const kernels::Lattice cut = lattice_over({{-5, 0, 0}, {5, 1, 2}}, 0.01, 3, {2, 0.5, 1});
    EXPECT_NEAR(cut.size[0], 300, 16);
    EXPECT_NEAR(cut.origin[0], 0.5, 0.09);
}

TEST(ConeBox, ReturnsVisibleFractionOfBox) {
    const Camera camera = camera_at("c", {0, -5, 1}, {0, 0, 1});
    double inside = -1;
    EXPECT_FALSE(projected_box(camera, {{-0.3, -0.3, 0.2}, {0.3, 0.3, 1.8}}, &inside).empty());
    EXPECT_GT(inside, 0.99);
    EXPECT_TRUE(projected_box(camera, {{9, -0.3, 0.2}, {9.6, 0.3, 1.8}}, &inside).empty());
    EXPECT_EQ(inside, 0);
    EXPECT_TRUE(projected_box(camera, {{-0.3, -9, 0.2}, {0.3, -8, 1.8}}, &inside).empty());
}

}  // namespace
}  // namespace kinevox
