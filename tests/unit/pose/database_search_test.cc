// Retrieval: the right pose, anywhere, with whatever cameras are left.
#include "server/pose/database/database_search.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "tests/unit/pose/database_fixture.h"

namespace kinevox {
namespace {

using Frames = std::vector<kernels::Silhouettes>;

double median(std::vector<double> values) {
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2),
                     values.end());
    return values[values.size() / 2];
}

BodyCoordinates placed(BodyCoordinates pose, double x, double y, double heading) {
    pose[0] = x, pose[1] = y, pose[2] = 0.95, pose[kDofRootRotation + 2] = heading;
    return pose;
}

class Retrieval : public ::testing::Test {
  protected:
    const PoseDatabase& database = room_database();
    const BodyModel model{database.shape};
    const std::vector<kernels::CameraModel> cameras = room_cameras();
};

TEST_F(Retrieval, FindsOwnPoses) {
    DatabaseSearch search(database);
    std::vector<double> errors;
    int same = 0, queries = 0;
    for (int pose = 3; pose < database.pose_count(); pose += 23, ++queries) {
        const double heading = 0.77 * pose;
        const BodyCoordinates truth =
            placed(database.poses[pose].coordinates, std::sin(pose), std::cos(pose), heading);
        RenderedFrame frame = render_frame(model, truth, cameras);
        frame.centre_in_world += Vec3{0.03, -0.02, 0.02};  // the tracked centre is never the body's
        const auto found = search.propose(frame.views(cameras), frame.centre_in_world, 5);
        ASSERT_EQ(found.size(), 5u);
        errors.push_back(mean_joint_distance(model, found[0].coordinates, truth));
        same += search.find(1)[0].pose == pose;
        for (std::size_t n = 1; n < found.size(); ++n) EXPECT_GE(found[n].distance, found[n - 1].distance);
        EXPECT_LE(std::fabs(found[0].coordinates[kDofRootRotation + 2]), std::numbers::pi + 1e-9);
    }
    EXPECT_GT(same, 0.85 * queries);
    EXPECT_LT(median(errors), 0.03);
}

TEST_F(Retrieval, CodesFindNearestWherePublishedRuleFails) {
    DatabaseSearch all(database), published(database, {.rule = RetrievalRule::kPublished}),
        exhaustive(database, {.rule = RetrievalRule::kExhaustive});
    int by_codes = 0, by_rule = 0, queries = 0;
    std::vector<double> errors;
    for (int n = 0; n < 40; ++n, ++queries) {
        const BodyCoordinates truth =
            placed(unseen_pose(n), 1.2 * std::sin(n), 1.2 * std::cos(2 * n), 2.4 * n);
        const RenderedFrame frame = render_frame(model, truth, cameras);
        const auto first = [&](DatabaseSearch& search) {
            EXPECT_EQ(search.describe(frame.views(cameras), frame.centre_in_world), 4);
            return search.find(1)[0];
        };
        const FoundPose nearest = first(exhaustive), codes = first(all), rule = first(published);
        by_codes += codes.pose == nearest.pose && codes.heading == nearest.heading;
        by_rule += rule.pose == nearest.pose && rule.heading == nearest.heading;
        EXPECT_GE(rule.distance, nearest.distance - 1e-6);
        errors.push_back(mean_joint_distance(model, all.place(codes).coordinates, truth));
    }
    EXPECT_GE(by_codes, 0.95 * queries);
    EXPECT_LT(by_rule, by_codes);
    EXPECT_LT(median(errors), 0.13);
}

TEST_F(Retrieval, IsDeterministic) {
    const RenderedFrame frame = render_frame(model, placed(unseen_pose(3), 0.4, -0.3, 1), cameras);
    DatabaseSearch one(database), other(database);
    const auto a = one.propose(frame.views(cameras), frame.centre_in_world, 8);
    one.propose(frame.views(cameras), {0.5, 0, 1}, 8);
    const auto b = one.propose(frame.views(cameras), frame.centre_in_world, 8);
    const auto c = other.propose(frame.views(cameras), frame.centre_in_world, 8);
    for (std::size_t n = 0; n < a.size(); ++n) {
        EXPECT_EQ(a[n].coordinates, b[n].coordinates);
        EXPECT_EQ(a[n].coordinates, c[n].coordinates);
        EXPECT_EQ(a[n].distance, c[n].distance);
    }
}

// The same poses and headings along 12 m: six cameras, of which a place is seen by some.
TEST(RetrievalOnALane, ErrorIsConstantAlongTwelveMetres) {
    const std::vector<kernels::CameraModel> cameras = lane_cameras();
    const PoseDatabase database = built(cameras, small_options(700));
    const BodyModel model(database.shape);
    DatabaseSearch search(database);
    std::vector<double> by_place;
    for (const double x : {0.5, 2.5, 4.5, 6.5, 8.5, 10.5, 11.5}) {
        std::vector<double> errors;
        int used = 0;
        for (int n = 0; n < 48; ++n) {
            const BodyCoordinates truth = placed(unseen_pose(n), x, 0.8 * std::sin(5.0 * n), 2.4 * n);
            const RenderedFrame frame = render_frame(model, truth, cameras);
            const auto found = search.propose(frame.views(cameras), frame.centre_in_world, 1);
            ASSERT_FALSE(found.empty());
            used += static_cast<int>(
                std::count(search.uses().begin(), search.uses().end(), SilhouetteUse::kUsed));
            errors.push_back(mean_joint_distance(model, found[0].coordinates, truth));
        }
        by_place.push_back(median(errors));
        std::printf("x = %4.1f m: median of the mean joint error %.0f mm, %.1f cameras\n", x,
                    1000 * by_place.back(), used / 48.0);
    }
    const double middle = median(by_place);
    for (const double error : by_place) {
        EXPECT_LT(error, 1.2 * middle);
        EXPECT_GT(error, 0.8 * middle);
    }
}

class BadSilhouettes : public Retrieval {
  protected:
    BodyCoordinates truth = placed(unseen_pose(1), 0.2, 0.1, 0.8);
    RenderedFrame frame = render_frame(model, truth, cameras);
    DatabaseSearch search{database};

    void fill(int camera, std::uint8_t value) {
        kernels::Silhouettes& s = frame.silhouettes[camera];
        std::fill(s.sharp.begin(), s.sharp.end(), value);
        s.bounds = value ? kernels::Rect{0, 0, s.width, s.height} : kernels::Rect{};
    }
    std::vector<PoseCandidate> ask(int most = 3) {
        return search.propose(frame.views(cameras), frame.centre_in_world, most);
    }
    void expect_without(int camera, SilhouetteUse use) {
        const auto found = ask();
        ASSERT_EQ(found.size(), 3u);
        EXPECT_EQ(search.uses()[camera], use);
        EXPECT_EQ(std::count(search.uses().begin(), search.uses().end(), SilhouetteUse::kUsed), 3);
        EXPECT_LT(mean_joint_distance(model, found[0].coordinates, truth), 0.2);
    }
};

TEST_F(BadSilhouettes, ExcludesEmptySilhouette) {
    fill(2, 0);
    expect_without(2, SilhouetteUse::kEmpty);
}

TEST_F(BadSilhouettes, ExcludesTooLargeSilhouette) {
    fill(0, 255);
    expect_without(0, SilhouetteUse::kTooLarge);
}

TEST_F(BadSilhouettes, ExcludesTruncatedSilhouette) {
    // The image ends in the middle of the person.
    kernels::Silhouettes& s = frame.silhouettes[1];
    std::vector<kernels::CameraModel> moved = cameras;
    const int shift = s.height - (s.bounds.y0 + s.bounds.y1) / 2;
    moved[1].cy += static_cast<float>(shift);
    frame = render_frame(model, truth, moved);
    const auto found = search.propose(frame.views(moved), frame.centre_in_world, 3);
    ASSERT_EQ(found.size(), 3u);
    EXPECT_EQ(search.uses()[1], SilhouetteUse::kTruncated);
    EXPECT_LT(mean_joint_distance(model, found[0].coordinates, truth), 0.2);
}

TEST_F(BadSilhouettes, ToleratesOneMissingCamera) {
    auto views = frame.views(cameras);
    views[3].silhouettes = nullptr;
    const auto found = search.propose(views, frame.centre_in_world, 3);
    ASSERT_EQ(found.size(), 3u);
    EXPECT_EQ(search.uses()[3], SilhouetteUse::kAbsent);
    EXPECT_LT(mean_joint_distance(model, found[0].coordinates, truth), 0.2);
}

TEST_F(BadSilhouettes, NoSilhouettesGiveNoCandidates) {
    for (int camera = 0; camera < 4; ++camera) fill(camera, camera % 2 ? 255 : 0);
    EXPECT_TRUE(ask().empty());
    EXPECT_TRUE(search.propose({}, {0, 0, 1}, 3).empty());
    frame = render_frame(model, truth, cameras);
    EXPECT_TRUE(search.propose(frame.views(cameras), {NAN, 0, 1}, 3).empty());
    EXPECT_TRUE(ask(0).empty());
    EXPECT_EQ(ask().size(), 3u);
}

TEST_F(Retrieval, ScalesSubjectOfOtherStature) {
    const BodyModel child(default_body_shape(1.3));
    BodyCoordinates truth = placed(unseen_pose(4), 0.3, 0.4, 2);
    truth[2] = 0.7;
    const RenderedFrame frame = render_frame(child, truth, cameras);
    DatabaseSearch unknown(database), known(database, {.stature_m = 1.3});
    const auto without = unknown.propose(frame.views(cameras), frame.centre_in_world, 1);
    const auto with = known.propose(frame.views(cameras), frame.centre_in_world, 1);
    EXPECT_LT(with[0].distance, without[0].distance);
    EXPECT_LT(mean_joint_distance(child, with[0].coordinates, truth), 0.1);
}

}  // namespace
}  // namespace kinevox
