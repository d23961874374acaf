// PoseService over an in-process channel: a small database of its own, a fake capture.
#include <cmath>

#include "kinevox/v1/pose_service.grpc.pb.h"
#include "tests/integration/api/api_fixture.h"
#include "tests/support/small_bvh.h"
#include "tests/unit/common/temporary_folder.h"

namespace kinevox {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;

constexpr int kOwn = 12;

kernels::CameraModel model_at(double x, double y) {
    kernels::CameraModel camera;
    camera.width = 640, camera.height = 480;
    camera.fx = camera.fy = 500, camera.cx = 319.5, camera.cy = 239.5;
    const Vec3 forward = normalized(Vec3{-x, -y, 0}), right = normalized(cross(forward, Vec3{0, 0, 1})),
               down{0, 0, -1};
    const Vec3 centre{x, y, 1};
    const Vec3 rows[3] = {right, down, forward};
    for (int i = 0; i < 3; ++i) {
        const double row[3] = {rows[i].x, rows[i].y, rows[i].z};
        for (int k = 0; k < 3; ++k) camera.rotation_camera_from_world[3 * i + k] = static_cast<float>(row[k]);
        camera.translation_camera_from_world[i] = static_cast<float>(-dot(rows[i], centre));
    }
    return camera;
}

class PoseApiTest : public ApiTest {
  protected:
    PoseApiTest() {
        api_.poses = &poses_;
        api_.pose_watch = &watch_;
        api_.changes = changes_.get_executor();
    }
    ~PoseApiTest() override {  // as the daemon does it
        poses_.close();
        watch_.close(absl::UnavailableError("the daemon is stopping; connect again later"));
        server_->shutdown(std::chrono::milliseconds(500));
        changes_.join();
    }
    void build(int poses = kOwn) {
        PoseDatabaseOptions options;
        options.poses = poses;
        poses_.start({model_at(4, 0), model_at(0, 4)}, default_body_shape(), options,
                     [this](const DatabaseProgress& progress) { watch_.publish(progress); });
    }
    v1::AddPoseRequest add(const std::string& label) {
        v1::AddPoseRequest request;
        request.set_label(label);
        return request;
    }
    std::vector<std::string> added() {
        std::vector<std::string> labels;
        const auto listed = client_.list_poses();
        EXPECT_TRUE(listed.ok()) << listed.status();
        for (const v1::PoseEntry& pose : listed->poses())
            if (pose.added()) labels.push_back(pose.label());
        return labels;
    }

    testing::TemporaryFolder folder_;
    DatabaseWatch watch_;
    PoseDatabaseService poses_{folder_.path() / "poses.kvxposes"};
    asio::thread_pool changes_{1};
};

TEST_F(ApiTest, ADaemonWithoutAPoseDatabaseSaysSo) {
    EXPECT_EQ(client_.list_poses().status().code(), absl::StatusCode::kFailedPrecondition);
    const absl::Status watched = client_.watch_database([](const auto&) { return true; }, {});
    EXPECT_EQ(watched.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(watched.message()), HasSubstr("[pose] database"));
}

TEST_F(PoseApiTest, WatchDatabaseTellsHowFarItIs) {
    EXPECT_EQ(client_.list_poses().status().code(), absl::StatusCode::kUnavailable) << "not built yet";
    std::vector<v1::WatchDatabaseResponse> told;
    const absl::Status status = client_.watch_database(
        [&](const auto& progress) {
            if (told.empty()) build();
            told.push_back(progress);
            return progress.state() != v1::DATABASE_STATE_READY;
        },
        {});
    ASSERT_TRUE(status.ok()) << status;
    EXPECT_EQ(told.front().state(), v1::DATABASE_STATE_NONE);
    EXPECT_EQ(told.front().entries(), 0);
    EXPECT_EQ(told.back().entries(), kOwn * 72);
    EXPECT_EQ(told.back().part(), 1);
    EXPECT_THAT(told.back().message(), HasSubstr("was not there yet"));
    for (std::size_t i = 1; i < told.size(); ++i) EXPECT_GE(told[i].part(), told[i - 1].part());

    // Who comes later is told the same, and that the daemon is stopping.
    const absl::Status ended = client_.watch_database(
        [&](const auto& progress) {
            EXPECT_EQ(progress.state(), v1::DATABASE_STATE_READY);
            watch_.close(absl::UnavailableError("the daemon is stopping; connect again later"));
            return true;
        },
        {});
    EXPECT_EQ(ended.code(), absl::StatusCode::kUnavailable);
}

TEST_F(PoseApiTest, PosesAreAddedListedAndRemoved) {
    build();
    poses_.wait();
    auto listed = client_.list_poses();
    ASSERT_TRUE(listed.ok()) << listed.status();
    EXPECT_EQ(listed->poses_size(), kOwn);
    EXPECT_EQ(listed->entries(), kOwn * 72);

    // The measured one: of the newest result.
    EXPECT_EQ(client_.add_pose("ann", add("as measured")).status().code(),
              absl::StatusCode::kFailedPrecondition)
        << "nobody has been measured yet";
    auto collected = collect({}, 1);
    start();
    source_.give(1);
    collected.get();
    auto response = client_.add_pose("ann", add("as measured"));
    ASSERT_TRUE(response.ok()) << response.status();
    EXPECT_EQ(response->entries(), (kOwn + 1) * 72);

    auto given = add("sitting");
    (*given.mutable_coordinates_deg())["knee_angle_l"] = 90;
    (*given.mutable_coordinates_deg())["hip_flexion_l"] = 85;
    ASSERT_TRUE(client_.add_pose("ann", given).ok());
    EXPECT_EQ(added(), (std::vector<std::string>{"as measured", "sitting"}));

    v1::RemovePoseRequest remove;
    remove.set_label("as measured");
    EXPECT_EQ(client_.remove_pose("ann", remove)->entries(), (kOwn + 1) * 72);
    EXPECT_EQ(client_.remove_pose("ann", remove).status().code(), absl::StatusCode::kNotFound);
    EXPECT_EQ(added(), std::vector<std::string>{"sitting"});
}

TEST_F(PoseApiTest, RefusesWhatMakesNoSense) {
    build();
    poses_.wait();
    const struct {
        const char* name;
        double degrees;
        const char* label;
        const char* said;
    } kTable[] = {{"knee_angle", 10, "x", "knee_angle_l"},
                  {"knee_angle_l", 500, "x", "-5 to 150"},
                  {"knee_angle_l", NAN, "x", "knee_angle_l"},
                  {"knee_angle_l", 10, "", "label"},
                  {"pelvis_tx", 1, "x", "pelvis_tx"}};
    for (const auto& row : kTable) {
        auto request = add(row.label);
        (*request.mutable_coordinates_deg())[row.name] = row.degrees;
        const absl::Status status = client_.add_pose("ann", request).status();
        EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << row.said << status;
        EXPECT_THAT(std::string(status.message()), HasSubstr(row.said));
    }
    v1::ImportBvhRequest import;
    import.set_label("walk");
    import.set_bvh("no movement");
    EXPECT_EQ(client_.import_bvh("ann", import).status().code(), absl::StatusCode::kInvalidArgument);
    import.set_bvh(testing::small_bvh(3));
    import.set_every_s(-1);
    EXPECT_EQ(client_.import_bvh("ann", import).status().code(), absl::StatusCode::kInvalidArgument);

    // Somebody else has control.
    acquire("bob");
    const absl::Status refused = client_.add_pose("ann", add("x")).status();
    EXPECT_EQ(refused.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(refused.message()), HasSubstr("bob"));
    EXPECT_TRUE(added().empty());
}

TEST_F(PoseApiTest, ChangesNeedTheLeaseItself) {
    build();
    poses_.wait();
    const auto stub = v1::PoseService::NewStub(server_->in_process_channel());
    const auto code = [&](auto method, auto request, auto response) {
        grpc::ClientContext context;
        request.set_lease_id("somebody's");
        return (stub.get()->*method)(&context, request, &response).error_code();
    };
    using Stub = v1::PoseService::Stub;
    EXPECT_EQ(code(&Stub::AddPose, v1::AddPoseRequest(), v1::AddPoseResponse()),
              grpc::StatusCode::FAILED_PRECONDITION);
    EXPECT_EQ(code(&Stub::RemovePose, v1::RemovePoseRequest(), v1::RemovePoseResponse()),
              grpc::StatusCode::FAILED_PRECONDITION);
    EXPECT_EQ(code(&Stub::ImportBvh, v1::ImportBvhRequest(), v1::ImportBvhResponse()),
              grpc::StatusCode::FAILED_PRECONDITION);
}

TEST_F(PoseApiTest, ImportBvhAddsAMovement) {
    build();
    poses_.wait();
    v1::ImportBvhRequest import;
    import.set_label("kick");
    import.set_bvh(testing::small_bvh(4));
    const auto response = client_.import_bvh("ann", import);
    ASSERT_TRUE(response.ok()) << response.status();
    EXPECT_EQ(response->poses(), 4);
    EXPECT_EQ(response->entries(), (kOwn + 4) * 72);
    EXPECT_THAT(added(), Contains("kick, 0.30 s"));

    // More than a small request may hold.
    import.set_bvh(testing::small_bvh(4) + std::string(3 << 20, ' '));
    EXPECT_TRUE(client_.import_bvh("ann", import).ok());

    // A change while it is built has to wait, and says so.
    build(2000);
    EXPECT_EQ(client_.import_bvh("ann", import).status().code(), absl::StatusCode::kUnavailable);
}

}  // namespace
}  // namespace kinevox
