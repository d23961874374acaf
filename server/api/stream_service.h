// StreamService: subscriptions checked, results translated.
#pragma once

#include <absl/status/statusor.h>

#include "kinevox/v1/stream_service.grpc.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

class StreamServiceImpl final : public v1::StreamService::CallbackService {
  public:
    explicit StreamServiceImpl(const ApiContext& api) : api_(api) {}

    grpc::ServerWriteReactor<v1::StreamVolumesResponse>* StreamVolumes(
        grpc::CallbackServerContext* context, const v1::StreamVolumesRequest* request) override;
    grpc::ServerWriteReactor<v1::StreamPosesResponse>* StreamPoses(grpc::CallbackServerContext* context,
                                                                   const v1::StreamPosesRequest* request) override;
    grpc::ServerWriteReactor<v1::StreamPreviewsResponse>* StreamPreviews(
        grpc::CallbackServerContext* context, const v1::StreamPreviewsRequest* request) override;

  private:
    const ApiContext& api_;
};

// Halvings of the resolution that keep an edge of `voxel_m` within `max_voxel_m`; 0 to kMostLevels.
inline constexpr int kMostLevels = 5;
int level_for(double voxel_m, double max_voxel_m);

}  // namespace kinevox
