// PoseService over an in-process channel, with a small pose database and a fake capture.
#include <cmath>

#include "common/proto_time.h"
#include "kinevox/v1/pose_service.grpc.pb.h"
#include "tests/integration/api/api_fixture.h"
#include "tests/support/small_bvh.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

using ::testing::Contains;
using ::testing::HasSubstr;

constexpr int kBuiltIn = 12;

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
        api_.poses.database = &poses_;
        api_.poses.database_watch = &watch_;
        api_.threads.changes = changes_.get_executor();
    }
    ~PoseApiTest() override {  // in the order of the daemon
        poses_.close();
        watch_.close(absl::UnavailableError("the daemon is stopping; connect again later"));
        server_->shutdown(std::chrono::milliseconds(500));
        changes_.join();
    }
    void build(int poses = kBuiltIn) {
        PoseDatabaseOptions options;
        options.poses = poses;
        poses_.start({model_at(4, 0), model_at(0, 4)}, default_body_shape(), options,
                     [this](const DatabaseProgress& progress) { watch_.publish(progress); });
    }
    v1::AddLibraryPoseRequest add(const std::string& label) {
        v1::AddLibraryPoseRequest request;
        request.set_label(label);
        return request;
    }
    std::vector<std::string> user_poses() {
        std::vector<std::string> labels;
        const auto listed = client_.list_library_poses();
        EXPECT_TRUE(listed.ok()) << listed.status();
        for (const v1::LibraryPose& pose : listed->poses())
            if (pose.user_defined()) labels.push_back(pose.label());
        return labels;
    }

    testing::TemporaryFolder folder_;
    DatabaseWatch watch_;
    PoseDatabaseService poses_{folder_.path() / "poses.kvxposes"};
    asio::thread_pool changes_{1};
};

TEST_F(ApiTest, CallsFailWithoutPoseDatabase) {
    EXPECT_EQ(client_.list_library_poses().status().code(), absl::StatusCode::kFailedPrecondition);
    const absl::Status watched = client_.watch_pose_database([](const auto&) { return true; }, {});
    EXPECT_EQ(watched.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(watched.message()), HasSubstr("[pose] database"));
}

TEST_F(PoseApiTest, WatchPoseDatabaseReportsProgress) {
    EXPECT_EQ(client_.list_library_poses().status().code(), absl::StatusCode::kUnavailable)
        << "not built yet";
    std::vector<v1::WatchPoseDatabaseResponse> reported;
    const absl::Status status = client_.watch_pose_database(
        [&](const auto& progress) {
            if (reported.empty()) build();
            reported.push_back(progress);
            return progress.state() != v1::POSE_DATABASE_STATE_READY;
        },
        {});
    ASSERT_TRUE(status.ok()) << status;
    EXPECT_EQ(reported.front().state(), v1::POSE_DATABASE_STATE_NOT_STARTED);
    EXPECT_EQ(reported.front().entry_count(), 0);
    EXPECT_EQ(reported.back().entry_count(), kBuiltIn * 72);
    EXPECT_EQ(reported.back().progress(), 1);
    EXPECT_THAT(reported.back().message(), HasSubstr("did not exist"));
    for (std::size_t i = 1; i < reported.size(); ++i)
        EXPECT_GE(reported[i].progress(), reported[i - 1].progress());

    // A later subscriber receives the same state, then the shutdown.
    const absl::Status ended = client_.watch_pose_database(
        [&](const auto& progress) {
            EXPECT_EQ(progress.state(), v1::POSE_DATABASE_STATE_READY);
            watch_.close(absl::UnavailableError("the daemon is stopping; connect again later"));
            return true;
        },
        {});
    EXPECT_EQ(ended.code(), absl::StatusCode::kUnavailable);
}

TEST_F(PoseApiTest, AddsListsAndDeletesPoses) {
    build();
    poses_.wait();
    auto listed = client_.list_library_poses();
    ASSERT_TRUE(listed.ok()) << listed.status();
    EXPECT_EQ(listed->poses_size(), kBuiltIn);
    EXPECT_EQ(listed->entry_count(), kBuiltIn * 72);

    // Without coordinates: the pose of the latest result.
    EXPECT_EQ(client_.add_library_pose("ann", add("as measured")).status().code(),
              absl::StatusCode::kFailedPrecondition)
        << "no pose has been measured yet";
    auto collected = collect({}, 1);
    start();
    source_.give(1);
    collected.get();
    auto response = client_.add_library_pose("ann", add("as measured"));
    ASSERT_TRUE(response.ok()) << response.status();
    EXPECT_EQ(response->entry_count(), (kBuiltIn + 1) * 72);

    auto given = add("sitting");
    (*given.mutable_coordinates_deg())["knee_angle_l"] = 90;
    (*given.mutable_coordinates_deg())["hip_flexion_l"] = 85;
    ASSERT_TRUE(client_.add_library_pose("ann", given).ok());
    EXPECT_EQ(user_poses(), (std::vector<std::string>{"as measured", "sitting"}));

    v1::DeleteLibraryPoseRequest remove;
    remove.set_label("as measured");
    EXPECT_EQ(client_.delete_library_pose("ann", remove)->entry_count(), (kBuiltIn + 1) * 72);
    EXPECT_EQ(client_.delete_library_pose("ann", remove).status().code(), absl::StatusCode::kNotFound);
    EXPECT_EQ(user_poses(), std::vector<std::string>{"sitting"});
}

TEST_F(PoseApiTest, RejectsInvalidRequests) {
    build();
    poses_.wait();
    const struct {
        const char* name;
        double degrees;
        const char* label;
        const char* message;
    } kTable[] = {{"knee_angle", 10, "x", "knee_angle_l"},
                  {"knee_angle_l", 500, "x", "-5 to 150"},
                  {"knee_angle_l", NAN, "x", "knee_angle_l"},
                  {"knee_angle_l", 10, "", "label"},
                  {"pelvis_x", 1, "x", "pelvis_x"}};
    for (const auto& row : kTable) {
        auto request = add(row.label);
        (*request.mutable_coordinates_deg())[row.name] = row.degrees;
        const absl::Status status = client_.add_library_pose("ann", request).status();
        EXPECT_EQ(status.code(), absl::StatusCode::kInvalidArgument) << row.message << status;
        EXPECT_THAT(std::string(status.message()), HasSubstr(row.message));
    }
    v1::ImportLibraryPosesRequest import;
    import.set_label("walk");
    import.set_data("no movement");
    EXPECT_EQ(client_.import_library_poses("ann", import).status().code(),
              absl::StatusCode::kInvalidArgument);
    import.set_data(testing::small_bvh(3));
    *import.mutable_interval() = duration_from_s(-1);
    EXPECT_EQ(client_.import_library_poses("ann", import).status().code(),
              absl::StatusCode::kInvalidArgument);

    // Another operator holds control.
    acquire("bob");
    const absl::Status refused = client_.add_library_pose("ann", add("x")).status();
    EXPECT_EQ(refused.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(refused.message()), HasSubstr("bob"));
    EXPECT_TRUE(user_poses().empty());
}

TEST_F(PoseApiTest, ChangesRequireTheLeaseId) {
    build();
    poses_.wait();
    const auto stub = v1::PoseService::NewStub(server_->in_process_channel());
    const auto code = [&](auto method, auto request, auto response) {
        grpc::ClientContext context;
        request.set_lease_id("another lease");
        return (stub.get()->*method)(&context, request, &response).error_code();
    };
    using Stub = v1::PoseService::Stub;
    EXPECT_EQ(code(&Stub::AddLibraryPose, v1::AddLibraryPoseRequest(), v1::AddLibraryPoseResponse()),
              grpc::StatusCode::FAILED_PRECONDITION);
    EXPECT_EQ(code(&Stub::DeleteLibraryPose, v1::DeleteLibraryPoseRequest(), v1::DeleteLibraryPoseResponse()),
              grpc::StatusCode::FAILED_PRECONDITION);
    EXPECT_EQ(
        code(&Stub::ImportLibraryPoses, v1::ImportLibraryPosesRequest(), v1::ImportLibraryPosesResponse()),
        grpc::StatusCode::FAILED_PRECONDITION);
}

TEST_F(PoseApiTest, ImportAddsMovement) {
    build();
    poses_.wait();
    v1::ImportLibraryPosesRequest import;
    import.set_label("kick");
    import.set_data(testing::small_bvh(4));
    const auto response = client_.import_library_poses("ann", import);
    ASSERT_TRUE(response.ok()) << response.status();
    EXPECT_EQ(response->pose_count(), 4);
    EXPECT_EQ(response->entry_count(), (kBuiltIn + 4) * 72);
    EXPECT_THAT(user_poses(), Contains("kick, 0.30 s"));

    // Larger than the limit of other requests.
    import.set_data(testing::small_bvh(4) + std::string(3 << 20, ' '));
    EXPECT_TRUE(client_.import_library_poses("ann", import).ok());

    // No changes during a rebuild.
    build(2000);
    EXPECT_EQ(client_.import_library_poses("ann", import).status().code(), absl::StatusCode::kUnavailable);
}

}  // namespace
}  // namespace kinevox
