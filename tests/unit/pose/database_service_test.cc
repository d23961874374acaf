// The database of a running daemon: built behind its back, asked meanwhile, changed, cancelled.
#include "server/pose/database/database_service.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>

#include "common/files.h"
#include "tests/support/temporary_folder.h"
#include "tests/unit/pose/database_fixture.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;

class Service : public ::testing::Test {
  protected:
    testing::TemporaryFolder folder;
    std::filesystem::path file = folder.path() / "poses.kvxposes";
    std::vector<kernels::CameraModel> cameras = room_cameras();
    const BodyShape shape = default_body_shape();
    const BodyModel model{shape};

    RenderedFrame frame() {
        BodyCoordinates pose = unseen_pose(2);
        pose[2] = 0.95, pose[kDofRootRotation + 2] = 1;
        return render_frame(model, pose, cameras);
    }
};

TEST_F(Service, BuildsInBackgroundThenAnswers) {
    PoseDatabaseService service(file);
    const RenderedFrame seen = frame();
    EXPECT_TRUE(service.propose(seen.views(cameras), seen.centre_in_world, 3).empty());
    EXPECT_TRUE(absl::IsUnavailable(service.list().status()));
    EXPECT_TRUE(absl::IsUnavailable(service.remove("x")));
    EXPECT_EQ(service.progress().state, PoseDatabaseState::kNotStarted);
    std::atomic<int> reports{0};
    service.start(cameras, shape, small_options(40), [&](const DatabaseProgress&) { ++reports; });
    service.wait();
    EXPECT_EQ(service.progress().state, PoseDatabaseState::kReady);
    EXPECT_THAT(service.progress().message, HasSubstr("did not exist"));
    EXPECT_GT(reports, 10);
    EXPECT_EQ(service.propose(seen.views(cameras), seen.centre_in_world, 3).size(), 3u);
    service.set_stature(1.5);
    EXPECT_EQ(service.propose(seen.views(cameras), seen.centre_in_world, 3).size(), 3u);

    PoseDatabaseService restarted(file);
    restarted.start(cameras, shape, small_options(40));
    restarted.wait();
    EXPECT_EQ(restarted.progress().message, "");
}

TEST_F(Service, ListsAddsAndRemovesPoses) {
    PoseDatabaseService service(file);
    service.start(cameras, shape, small_options(30));
    service.wait();
    EXPECT_EQ(service.list()->size(), 30u);
    const LibraryPose mine{"mine", unseen_pose(3), false};
    ASSERT_TRUE(service.add(std::span(&mine, 1)).ok());
    EXPECT_EQ(service.list()->size(), 31u);
    EXPECT_TRUE(service.list()->back().user_defined);
    PoseDatabaseService restarted(file);
    restarted.start(cameras, shape, small_options(30));
    restarted.wait();
    EXPECT_EQ(restarted.progress().message, "");
    EXPECT_EQ(restarted.list()->back().label, "mine");
    ASSERT_TRUE(service.remove("mine").ok());
    EXPECT_TRUE(absl::IsNotFound(service.remove("mine")));
    EXPECT_TRUE(absl::IsInvalidArgument(service.import_bvh("nonsense", "m").status()));
    EXPECT_EQ(service.list()->size(), 30u);
}

TEST_F(Service, CancelledBuildKeepsOldDatabase) {
    PoseDatabaseService service(file);
    service.start(cameras, shape, small_options(30));
    service.wait();
    service.start(lane_cameras(), shape, small_options(3000));
    EXPECT_EQ(service.progress().state, PoseDatabaseState::kBuilding);
    const RenderedFrame seen = frame();
    EXPECT_FALSE(service.propose(seen.views(cameras), seen.centre_in_world, 3).empty());
    service.cancel();
    service.wait();
    EXPECT_EQ(service.progress().state, PoseDatabaseState::kCancelled);
    EXPECT_EQ(service.list()->size(), 30u);
    service.start(cameras, shape, small_options(3000));  // the destructor stops it
}

TEST_F(Service, ReportsFailure) {
    PoseDatabaseService service(file);
    service.start({}, shape, small_options(30));
    service.wait();
    EXPECT_EQ(service.progress().state, PoseDatabaseState::kFailed);
    EXPECT_THAT(service.progress().message, HasSubstr("no camera"));
}

// Whatever the builder is at: a daemon that ends must not wait for it.
TEST_F(Service, CancelsSoonAtEveryStageOfBuild) {
    using std::chrono::steady_clock;
    PoseDatabaseOptions options;  // of full size, but that a build takes a second or two
    options.poses = 150;
    for (const double part : {0.0, 0.01, 0.5, 0.96, 0.97}) {
        std::filesystem::remove(file);
        PoseDatabaseService service(file);
        std::atomic<bool> there = part == 0;
        service.start(cameras, shape, options, [&](const DatabaseProgress& progress) {
            if (progress.progress < part) return;
            there = true;
            there.notify_all();
        });
        there.wait(false);
        const auto start = steady_clock::now();
        service.close();
        service.wait();
        const auto took = steady_clock::now() - start;
        EXPECT_LT(took, std::chrono::milliseconds(400)) << "at " << part;
        EXPECT_EQ(service.progress().state, PoseDatabaseState::kCancelled) << "at " << part;
        EXPECT_FALSE(std::filesystem::exists(file)) << "no half database";
    }
}

}  // namespace
}  // namespace kinevox
