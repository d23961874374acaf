// PoseService on gRPC's callback API hands each call to its handler on the right thread. Handlers, one
// function per method: check, act, translate. Those that change the database block and run on its thread for
// changes, after check_pose_database().
#pragma once

#include <absl/status/status.h>

#include "kinevox/v1/pose_service.grpc.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

// FailedPrecondition if this daemon has no pose database.
absl::Status check_pose_database(const ApiContext& api);

absl::Status list_library_poses(const ApiContext& api, const v1::ListLibraryPosesRequest& request,
                                v1::ListLibraryPosesResponse& response);
absl::Status add_library_pose(const ApiContext& api, const v1::AddLibraryPoseRequest& request,
                              v1::AddLibraryPoseResponse& response);
absl::Status delete_library_pose(const ApiContext& api, const v1::DeleteLibraryPoseRequest& request,
                                 v1::DeleteLibraryPoseResponse& response);
absl::Status import_library_poses(const ApiContext& api, const v1::ImportLibraryPosesRequest& request,
                                  v1::ImportLibraryPosesResponse& response);
v1::WatchPoseDatabaseResponse to_proto(const DatabaseProgress& progress);

// FailedPrecondition if this daemon measures no poses.
absl::Status check_body_fit(const ApiContext& api);
absl::Status fit_body(const ApiContext& api, const v1::FitBodyRequest& request);
// The body of the tracked subject, or the default body.
v1::WatchBodyResponse body_to_proto(const std::vector<BodyFitProgress>& subjects);

class PoseServiceImpl final : public v1::PoseService::CallbackService {
  public:
    explicit PoseServiceImpl(const ApiContext& api) : api_(api) {}

    using Context = grpc::CallbackServerContext;
    using Reactor = grpc::ServerUnaryReactor;
    Reactor* ListLibraryPoses(Context*, const v1::ListLibraryPosesRequest*,
                              v1::ListLibraryPosesResponse*) override;
    Reactor* AddLibraryPose(Context*, const v1::AddLibraryPoseRequest*, v1::AddLibraryPoseResponse*) override;
    Reactor* DeleteLibraryPose(Context*, const v1::DeleteLibraryPoseRequest*,
                               v1::DeleteLibraryPoseResponse*) override;
    Reactor* ImportLibraryPoses(Context*, const v1::ImportLibraryPosesRequest*,
                                v1::ImportLibraryPosesResponse*) override;
    grpc::ServerWriteReactor<v1::WatchPoseDatabaseResponse>* WatchPoseDatabase(
        Context*, const v1::WatchPoseDatabaseRequest*) override;
    Reactor* FitBody(Context*, const v1::FitBodyRequest*, v1::FitBodyResponse*) override;
    grpc::ServerWriteReactor<v1::WatchBodyResponse>* WatchBody(Context*,
                                                               const v1::WatchBodyRequest*) override;

  private:
    const ApiContext& api_;
};

}  // namespace kinevox
