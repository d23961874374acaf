// The database on disk, and a user's changes to it.
#include "server/pose/database/database_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>

#include "common/files.h"
#include "server/pose/database/database_search.h"
#include "tests/support/temporary_folder.h"
#include "tests/unit/pose/database_fixture.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;

void expect_same(const PoseDatabase& a, const PoseDatabase& b) {
    EXPECT_EQ(a.fingerprint, b.fingerprint);
    EXPECT_EQ(a.shape, b.shape);
    EXPECT_EQ(a.poses, b.poses);
    EXPECT_EQ(a.removed, b.removed);
    EXPECT_EQ(a.body_centres, b.body_centres);
    EXPECT_EQ(a.viewpoints, b.viewpoints);
    EXPECT_EQ(a.code_basis, b.code_basis);
    ASSERT_EQ(a.slabs.size(), b.slabs.size());
    for (std::size_t n = 0; n < a.slabs.size(); ++n) {
        EXPECT_EQ(a.slabs[n].moments, b.slabs[n].moments);
        EXPECT_EQ(a.slabs[n].centres, b.slabs[n].centres);
        EXPECT_EQ(a.slabs[n].codes, b.slabs[n].codes);
        EXPECT_EQ(a.slabs[n].silhouettes, b.slabs[n].silhouettes);
        EXPECT_EQ(a.slabs[n].search.blocks, b.slabs[n].search.blocks);
    }
}

class DatabaseFile : public ::testing::Test {
  protected:
    testing::TemporaryFolder folder;
    std::filesystem::path file = folder.path() / "poses.kvxposes";
    std::vector<kernels::CameraModel> cameras = room_cameras();
    BodyShape shape = default_body_shape();
    PoseDatabaseOptions options = small_options(20);

    OpenedDatabase open() {
        auto opened = open_pose_database(file, cameras, shape, options);
        EXPECT_TRUE(opened.ok()) << opened.status();
        return *std::move(opened);
    }
    std::string bytes() { return *read_file(file, std::size_t{1} << 30); }
};

TEST_F(DatabaseFile, RestartDoesNotRebuild) {
    const OpenedDatabase first = open();
    EXPECT_THAT(first.rebuilt_because, HasSubstr("did not exist"));
    const OpenedDatabase second = open();
    EXPECT_EQ(second.rebuilt_because, "");
    expect_same(first.database, second.database);
}

TEST_F(DatabaseFile, DamagedFileIsRebuiltWithMessage) {
    const OpenedDatabase first = open();
    const std::string good = bytes();
    for (const std::size_t at :
         {std::size_t{0}, std::size_t{20}, std::size_t{40}, good.size() / 2, good.size() - 1}) {
        std::string bad = good;
        bad[at] = static_cast<char>(bad[at] ^ 0x10);
        EXPECT_TRUE(absl::IsDataLoss(parse_pose_database(bad, "x").status())) << at;
    }
    for (const std::size_t size : {std::size_t{0}, std::size_t{7}, std::size_t{31}, good.size() - 1})
        EXPECT_TRUE(absl::IsDataLoss(parse_pose_database(good.substr(0, size), "x").status())) << size;
    EXPECT_TRUE(absl::IsDataLoss(parse_pose_database(good + "x", "x").status()));
    ASSERT_TRUE(write_file_atomically(file, good.substr(0, good.size() / 3)).ok());
    const OpenedDatabase again = open();
    EXPECT_THAT(again.rebuilt_because, HasSubstr("is truncated"));
    expect_same(first.database, again.database);
    EXPECT_EQ(open().rebuilt_because, "");
}

TEST_F(DatabaseFile, OldVersionIsRebuiltWithMessage) {
    open();
    std::string old = bytes();
    old[8] = 0;
    EXPECT_TRUE(absl::IsFailedPrecondition(parse_pose_database(old, "x").status()));
    ASSERT_TRUE(write_file_atomically(file, old).ok());
    EXPECT_THAT(open().rebuilt_because, HasSubstr("has version 0"));
    EXPECT_EQ(open().rebuilt_because, "");
}

TEST_F(DatabaseFile, RebuildKeepsUserPoses) {
    OpenedDatabase first = open();
    const LibraryPose mine{"my pose", unseen_pose(5), false};
    ASSERT_TRUE(add_poses(first.database, std::span(&mine, 1)).ok());
    const std::string taken_out = first.database.poses[3].label;
    ASSERT_TRUE(first.database.remove(taken_out).ok());
    ASSERT_TRUE(write_pose_database(first.database, file).ok());
    expect_same(first.database, open().database);

    shape = default_body_shape(1.9);
    const OpenedDatabase second = open();
    EXPECT_THAT(second.rebuilt_because, HasSubstr("another body"));
    EXPECT_THAT(second.database.poses, ::testing::Contains(::testing::Field(&LibraryPose::label, "my pose")));
    EXPECT_THAT(second.database.poses,
                ::testing::Not(::testing::Contains(::testing::Field(&LibraryPose::label, taken_out))));
    cameras = lane_cameras();
    EXPECT_THAT(open().rebuilt_because, HasSubstr("other cameras"));
    EXPECT_EQ(open().rebuilt_because, "");
}

TEST_F(DatabaseFile, ReportsUnwritableFile) {
    ASSERT_TRUE(write_file_atomically(folder.path() / "blocked", "x").ok());
    file = folder.path() / "blocked" / "poses.kvxposes";
    const OpenedDatabase opened = open();
    EXPECT_THAT(opened.rebuilt_because, HasSubstr("cannot be written"));
    EXPECT_EQ(opened.database.pose_count(), 20);
}

TEST(PoseDatabaseChanges, FindsAddedAndNotRemovedPoses) {
    PoseDatabase database = built(room_cameras(), small_options(200));
    const BodyModel model(database.shape);
    BodyCoordinates odd = unseen_pose(17, 12);
    const LibraryPose added{"odd one", odd, false};
    ASSERT_TRUE(add_poses(database, std::span(&added, 1)).ok());
    EXPECT_EQ(database.pose_count(), 201);
    EXPECT_TRUE(database.poses.back().user_defined);
    odd[0] = 0.4, odd[2] = 1, odd[kDofRootRotation + 2] = 1.3;
    const RenderedFrame frame = render_frame(model, odd, room_cameras());
    const std::vector<kernels::CameraModel> cameras = room_cameras();
    const auto first = [&] {
        DatabaseSearch search(database);
        search.describe(frame.views(cameras), frame.centre_in_world);
        return database.poses[search.find(1)[0].pose].label;
    };
    EXPECT_EQ(first(), "odd one");
    const auto silhouette = database.silhouette(0, 150, 7);
    const std::string label = database.poses[150].label;
    ASSERT_TRUE(database.remove(10).ok());
    EXPECT_EQ(database.poses[149].label, label);
    EXPECT_EQ(database.silhouette(0, 149, 7), silhouette);
    EXPECT_EQ(first(), "odd one");
    ASSERT_TRUE(database.remove("odd one").ok());
    EXPECT_NE(first(), "odd one");
    EXPECT_EQ(database.pose_count(), 199);
    EXPECT_EQ(database.removed.size(), 1u);
    EXPECT_TRUE(absl::IsNotFound(database.remove("odd one")));
    EXPECT_TRUE(absl::IsNotFound(database.remove(199)));
    EXPECT_TRUE(absl::IsNotFound(database.remove(-1)));
    const LibraryPose bad[] = {{"", odd, false}, {"two\nlines", odd, false}};
    for (const LibraryPose& pose : bad)
        EXPECT_TRUE(absl::IsInvalidArgument(add_poses(database, std::span(&pose, 1))));
    LibraryPose nan{"nan", odd, false};
    nan.coordinates[kDofKneeL] = NAN;
    EXPECT_THAT(std::string(add_poses(database, std::span(&nan, 1)).message()), HasSubstr("knee_angle_l"));
    EXPECT_EQ(database.pose_count(), 199);
}

TEST(PoseDatabaseBuilding, ReportsProgressAndCancels) {
    std::vector<double> seen;
    auto built = build_pose_database(room_cameras(), default_body_shape(), small_options(150), {},
                                     [&](double part) { seen.push_back(part); });
    ASSERT_TRUE(built.ok());
    EXPECT_GT(seen.size(), 20u);
    EXPECT_TRUE(std::is_sorted(seen.begin(), seen.end()));
    EXPECT_EQ(seen.back(), 1.0);
    std::stop_source source;
    auto cancelled = build_pose_database(
        room_cameras(), default_body_shape(), small_options(1400), {},
        [&](double part) {
            if (part > 0.02) source.request_stop();
        },
        source.get_token());
    EXPECT_TRUE(absl::IsCancelled(cancelled.status()));
}

TEST(PoseDatabaseBuilding, RejectsInvalidInputByName) {
    PoseDatabaseOptions options;
    options.order = 21;
    EXPECT_THAT(
        std::string(build_pose_database(room_cameras(), default_body_shape(), options).status().message()),
        HasSubstr("order is 21"));
    EXPECT_THAT(std::string(build_pose_database({}, default_body_shape(), {}).status().message()),
                HasSubstr("no camera"));
    std::vector<kernels::CameraModel> cameras = room_cameras();
    cameras[2].fx = NAN;
    EXPECT_TRUE(absl::IsInvalidArgument(build_pose_database(cameras, default_body_shape(), {}).status()));
    EXPECT_EQ(PoseDatabaseOptions{}.check(), "");
    for (const auto& change : std::vector<std::function<void(PoseDatabaseOptions&)>>{
             [](auto& o) { o.poses = 0; }, [](auto& o) { o.side_px = 50; },
             [](auto& o) { o.half_width_per_stature = NAN; }, [](auto& o) { o.elevation_step_deg = 0; },
             [](auto& o) { o.inverse_distance_step = 0; }, [](auto& o) { o.threads = 0; }}) {
        PoseDatabaseOptions bad;
        change(bad);
        EXPECT_NE(bad.check(), "");
    }
}

}  // namespace
}  // namespace kinevox
