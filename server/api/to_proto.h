// Results, states and certificates as the API's messages, and results as serialised messages.
#pragma once

#include <absl/status/status.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/status.h>

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "common/body_pose.h"
#include "common/camera.h"
#include "kinevox/v1/calibration_service.pb.h"
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

// From the text of certificate_json(). Members that are missing or of another type are absent. The method of
// a certificate, or of a stored calibration, by its name in JSON ("extrinsics_wand"); UNSPECIFIED for an
// unknown one.
v1::CalibrationMethod calibration_method_to_proto(std::string_view name);
v1::Certificate certificate_to_proto(const std::string& json);

// Below: serialised messages without header.missed_count, which differs per subscriber. Encoded on the
// encoders' threads for the first subscriber that needs a form, and shared with the others.
using EncodedMessage = std::shared_ptr<const std::string>;

// StreamVolumesResponse. The runner provides the cameras' names.
EncodedMessage encode(const PublishedVolume& published, const VolumeForm& form, const Runner& runner);
// StreamPosesResponse.
EncodedMessage encode(const PublishedPose& published);
// StreamPreviewsResponse; its jpeg is empty if there is no image or no silhouette.
EncodedMessage encode(const PublishedImages& published, const PreviewForm& form, const std::string& camera);

// The bytes for one subscriber: the shared bytes, uncopied, followed by a header with missed_count only.
// Protocol Buffers' parsers merge a message field that occurs twice (Encoding, "Last One Wins").
grpc::ByteBuffer to_buffer(const EncodedMessage& message, std::uint64_t missed_count);

}  // namespace kinevox
