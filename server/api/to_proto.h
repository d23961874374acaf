// What the pipeline says, as the API's messages.
#pragma once

#include <absl/status/status.h>
#include <grpcpp/support/status.h>

#include <cstdint>

#include "common/body_pose.h"
#include "common/camera.h"
#include "kinevox/v1/capture_service.pb.h"
#include "kinevox/v1/pose.pb.h"
#include "kinevox/v1/types.pb.h"
#include "server/pipeline/frame_result.h"
#include "server/pipeline/runner.h"
#include "server/pipeline/stream_hub.h"

namespace kinevox {

v1::Vec3 to_proto(const Vec3& vector);
v1::Camera to_proto(const Camera& camera);
v1::StageTimes to_proto(const StageTimes& times);
v1::Subject to_proto(const SubjectTrack& track, const std::vector<Camera>& cameras);
v1::Pose to_proto(const BodyPose& pose);
v1::CameraLink to_proto(const CameraLink& link);
v1::CaptureState to_proto(RunState state);
v1::EventKind to_proto(EventKind kind);
v1::WatchEventsResponse to_proto(const PublishedEvent& published, std::uint64_t missed);

grpc::Status to_grpc(const absl::Status& status);  // both count the same codes

}  // namespace kinevox
