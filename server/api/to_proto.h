// Results and states of the pipeline as the API's messages.
#pragma once

#include <absl/status/status.h>
#include <grpcpp/support/status.h>

#include <cstdint>

#include "common/body_pose.h"
#include "common/camera.h"
#include "kinevox/v1/capture_service.pb.h"
#include "kinevox/v1/pose.pb.h"
#include "kinevox/v1/types.pb.h"
#include "server/cameras/camera_connection.h"
#include "server/events/event_log.h"
#include "server/pipeline/frame_result.h"
#include "server/pipeline/runner.h"
#include "server/pipeline/stream_hub.h"

namespace kinevox {

v1::Vec3 to_proto(const Vec3& vector);
v1::Camera to_proto(const Camera& camera);
v1::StageTimes to_proto(const StageTimes& stage_times);
v1::Subject to_proto(const SubjectTrack& track, const std::vector<Camera>& cameras);
v1::Pose to_proto(const BodyPose& pose);
v1::TimestampSource to_proto(TimestampSource source);
v1::CameraConnection to_proto(const CameraConnection& connection);
v1::CaptureState to_proto(RunState state);
v1::EventKind to_proto(EventKind kind);
v1::WatchEventsResponse to_proto(const PublishedEvent& published, std::uint64_t missed_count);

grpc::Status to_grpc(const absl::Status& status);  // both number the codes equally

}  // namespace kinevox
