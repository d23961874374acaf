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
    Reactor* ListPoses(Context*, const v1::ListPosesRequest*, v1::ListPosesResponse*) override;
    Reactor* AddPose(Context*, const v1::AddPoseRequest*, v1::AddPoseResponse*) override;
    Reactor* RemovePose(Context*, const v1::RemovePoseRequest*, v1::RemovePoseResponse*) override;
    Reactor* ImportBvh(Context*, const v1::ImportBvhRequest*, v1::ImportBvhResponse*) override;
    grpc::ServerWriteReactor<v1::WatchDatabaseResponse>* WatchDatabase(
        Context*, const v1::WatchDatabaseRequest*) override;
    Reactor* FitBody(Context*, const v1::FitBodyRequest*, v1::FitBodyResponse*) override;
    grpc::ServerWriteReactor<v1::WatchBodyResponse>* WatchBody(Context*,
                                                               const v1::WatchBodyRequest*) override;

  private:
    const ApiContext& api_;
};

}  // namespace kinevox
