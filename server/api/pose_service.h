// PoseService on gRPC's callback API: hands each call to its handler on the right thread.
#pragma once

#include "kinevox/v1/pose_service.grpc.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

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
