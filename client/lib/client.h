// The C++ client of a Kinevox daemon. Needs gRPC, the API's messages and common; nothing of the server.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <stop_token>
#include <string>
#include <vector>

#include "common/camera.h"
#include "common/volume.h"
#include "kinevox/v1/calibration_service.pb.h"
#include "kinevox/v1/capture_service.pb.h"
#include "kinevox/v1/pose_service.pb.h"
#include "kinevox/v1/recording_service.pb.h"
#include "kinevox/v1/replay_service.pb.h"
#include "kinevox/v1/stream_service.pb.h"

namespace grpc {
class Channel;
}

namespace kinevox::client {

// TLS, trusted CAs, client certificate and token of the connection: contents of the files below. The default,
// no TLS and no token, suits a daemon on this machine.
struct Security {
    bool tls = false;
    std::string ca_pem;  // CAs that may have signed the daemon's certificate; empty: the system's
    std::string certificate_pem,
        key_pem;              // of the client, for daemons that require it (mutual TLS); empty: none
    std::string server_name;  // expected name in the daemon's certificate; empty: HOST
    std::string token;        // sent with each call; empty: none
};

// As users give it. Any file but the token's implies TLS.
struct SecurityFiles {
    bool tls = false;
    std::string ca, certificate, key;  // PEM
    std::string server_name;
    std::string token;  // its first line is the token
};

// InvalidArgument or NotFound with the file and the remedy. A token without TLS is refused unless `server`
// (HOST:PORT) is on this machine: it would be sent unencrypted.
absl::StatusOr<Security> read_security(const SecurityFiles& files, const std::string& server);

inline constexpr const char* kDefaultServer = "127.0.0.1:50770";

struct ClientOptions {
    std::string server = kDefaultServer;       // HOST:PORT
    std::chrono::milliseconds timeout{5'000};  // of a call, including the connection
    Security security;                         // default: a daemon on this machine
};

struct StreamOptions {
    // Reconnects, with growing pauses up to 5 s, when the daemon becomes unavailable. Messages published
    // meanwhile are lost.
    bool reconnect = false;
    std::function<void(const absl::Status& why)> on_reconnect;
    // Ends the stream with DeadlineExceeded after this time without a message; 0: waits for ever.
    std::chrono::milliseconds idle_timeout{0};
    std::stop_token stop;  // ends the stream with Cancelled, from any thread
};

// The lease of a client that holds control; see HeldControl (client_parts.h) for one that is renewed and
// released.
struct Lease {
    std::string id;
};

// A subject of one message of StreamVolumes, decoded.
struct SubjectVolume {
    v1::Subject subject;
    std::optional<Volume> volume;   // absent: tracked, but nothing was carved
    double volume_litres = 0;       // at the resolution of the capture
    std::size_t encoded_bytes = 0;  // on the wire
};

struct VolumeFrame {
    v1::StreamHeader header;
    std::vector<SubjectVolume> subjects;  // by id; empty while no subject is tracked

    const SubjectVolume* first_subject() const { return subjects.empty() ? nullptr : &subjects.front(); }
};

// Removes the other subjects; 0 keeps all.
void keep_subject(VolumeFrame& frame, std::uint32_t subject_id);
void keep_subject(v1::StreamPosesResponse& message, std::uint32_t subject_id);

// 8 bits per channel, R G B or grey, rows without padding.
struct Image {
    int width = 0, height = 0, channels = 0;
    std::vector<std::uint8_t> data;
};

struct PreviewFrame {
    v1::StreamHeader header;
    std::string camera;
    Image image;  // empty where the camera delivered no image
};

// Any thread; a stream occupies the thread that called it until it ends. The statuses are the daemon's own;
// Unavailable where there is no connection, with the address in the message. Where a call takes an operator
// name, it acquires control under that name, acts and releases control (see HeldControl); a lease_id in the
// request is overwritten. Lists are complete: all pages are fetched.
class Client {
  public:
    explicit Client(const ClientOptions& options = {});
    Client(std::shared_ptr<grpc::Channel> channel, const ClientOptions& options = {});
    ~Client();
    Client(Client&&) noexcept;

    absl::StatusOr<v1::GetStatusResponse> status();
    absl::StatusOr<std::vector<Camera>> cameras();

    absl::StatusOr<v1::AcquireControlResponse> acquire_control(const v1::AcquireControlRequest& request);
    absl::StatusOr<v1::RenewControlResponse> renew_control(const std::string& lease_id);
    absl::Status release_control(const std::string& lease_id);
    absl::Status with_control(const std::string& operator_name,
                              const std::function<absl::Status(const Lease& lease)>& act);

    absl::Status start(const std::string& operator_name);
    absl::Status start(const Lease& lease);
    absl::Status stop(const std::string& operator_name);
    absl::Status stop(const Lease& lease);
    // Live frame sets to learn from; 0: the source's own background clip. Waits until it is done, `timeout`
    // at most. FailedPrecondition while a subject is tracked, unless `force`.
    absl::Status learn_background(const std::string& operator_name, int frame_set_count,
                                  std::chrono::milliseconds timeout, bool force = false);
    absl::Status learn_background(const Lease& lease, int frame_set_count, std::chrono::milliseconds timeout,
                                  bool force = false);
    // The background before the last one that was learned; the capture is stopped.
    absl::Status restore_background(const std::string& operator_name);

    // People in the scene, and who of them is followed.
    absl::StatusOr<v1::ListSubjectsResponse> list_subjects();
    absl::Status select_subjects(const std::string& operator_name, v1::SelectSubjectsRequest request);
    absl::Status name_subject(const std::string& operator_name, v1::NameSubjectRequest request);

    // `on_...` returns whether to continue; false ends the stream with OK.
    absl::Status stream_volumes(const v1::StreamVolumesRequest& request,
                                const std::function<bool(const VolumeFrame&)>& on_frame,
                                const StreamOptions& options);
    absl::Status stream_poses(const v1::StreamPosesRequest& request,
                              const std::function<bool(const v1::StreamPosesResponse&)>& on_pose,
                              const StreamOptions& options);
    absl::Status stream_previews(const v1::StreamPreviewsRequest& request,
                                 const std::function<bool(const PreviewFrame&)>& on_frame,
                                 const StreamOptions& options);
    absl::Status watch_events(const v1::WatchEventsRequest& request,
                              const std::function<bool(const v1::WatchEventsResponse&)>& on_event,
                              const StreamOptions& options);

    // The pose database and the body.
    absl::StatusOr<v1::ListLibraryPosesResponse> list_library_poses();
    absl::StatusOr<v1::AddLibraryPoseResponse> add_library_pose(const std::string& operator_name,
                                                                v1::AddLibraryPoseRequest request);
    absl::StatusOr<v1::DeleteLibraryPoseResponse> delete_library_pose(const std::string& operator_name,
                                                                      v1::DeleteLibraryPoseRequest request);
    absl::StatusOr<v1::ImportLibraryPosesResponse> import_library_poses(
        const std::string& operator_name, v1::ImportLibraryPosesRequest request);
    absl::Status watch_pose_database(
        const std::function<bool(const v1::WatchPoseDatabaseResponse&)>& on_progress,
        const StreamOptions& options);
    // Starts a fit; watch_body() reports its progress.
    absl::Status fit_body(const std::string& operator_name, v1::FitBodyRequest request);
    absl::Status watch_body(const std::function<bool(const v1::WatchBodyResponse&)>& on_progress,
                            const StreamOptions& options);

    // Replay of a recording instead of the cameras. A lease_id in the request is used instead of acquiring
    // control.
    absl::StatusOr<v1::OpenReplayResponse> open_replay(const std::string& operator_name,
                                                       v1::OpenReplayRequest request);
    absl::Status close_replay(const std::string& operator_name);
    absl::StatusOr<v1::UpdateReplayResponse> update_replay(const std::string& operator_name,
                                                           v1::UpdateReplayRequest request);
    absl::StatusOr<v1::GetReplayResponse> get_replay();

    // Calibration. Requests that need control carry their lease_id.
    absl::StatusOr<v1::StartProcedureResponse> start_procedure(const v1::StartProcedureRequest& request);
    absl::StatusOr<v1::AddObservationsResponse> add_observations(const v1::AddObservationsRequest& request);
    absl::StatusOr<v1::SolveProcedureResponse> solve_procedure(const v1::SolveProcedureRequest& request);
    absl::StatusOr<v1::CancelProcedureResponse> cancel_procedure(const v1::CancelProcedureRequest& request);
    absl::StatusOr<v1::ListCalibrationsResponse> list_calibrations(v1::ListCalibrationsRequest request);
    absl::StatusOr<v1::GetCertificateResponse> get_certificate(const v1::GetCertificateRequest& request);
    absl::StatusOr<v1::ApplyCalibrationResponse> apply_calibration(
        const v1::ApplyCalibrationRequest& request);
    absl::StatusOr<v1::UndoCalibrationResponse> undo_calibration(const v1::UndoCalibrationRequest& request);
    absl::StatusOr<v1::ImportCalibrationResponse> import_calibration(
        const v1::ImportCalibrationRequest& request);
    absl::StatusOr<v1::ExportCalibrationResponse> export_calibration(
        const v1::ExportCalibrationRequest& request);
    absl::StatusOr<v1::DeleteCalibrationResponse> delete_calibration(
        const v1::DeleteCalibrationRequest& request);
    absl::Status watch_procedure(const std::function<bool(const v1::WatchProcedureResponse&)>& on_progress,
                                 const StreamOptions& options);

    // Recordings. `timeout` for the calls that wait until the queue is written.
    absl::StatusOr<v1::StartRecordingResponse> start_recording(const std::string& operator_name,
                                                               v1::StartRecordingRequest request);
    absl::StatusOr<v1::StopRecordingResponse> stop_recording(const std::string& operator_name,
                                                             std::chrono::milliseconds timeout);
    absl::StatusOr<v1::SaveBufferResponse> save_buffer(const std::string& operator_name,
                                                       v1::SaveBufferRequest request,
                                                       std::chrono::milliseconds timeout);
    absl::StatusOr<v1::DeleteRecordingResponse> delete_recording(const std::string& operator_name,
                                                                 v1::DeleteRecordingRequest request);
    absl::StatusOr<v1::GetRecorderStatusResponse> recorder_status();
    absl::StatusOr<v1::ListRecordingsResponse> list_recordings();
    absl::StatusOr<v1::GetRecordingResponse> get_recording(const std::string& name);
    // The chunks of the files in their order; before the first one, progress (0 to 1) four times per second.
    absl::Status export_recording(v1::ExportRecordingRequest request,
                                  const std::function<bool(const v1::ExportRecordingResponse&)>& on_chunk,
                                  const std::function<void(double progress)>& on_progress,
                                  const StreamOptions& options);

  private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

Camera camera_from_proto(const v1::Camera& camera);

}  // namespace kinevox::client
