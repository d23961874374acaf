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

#include "client/lib/security.h"
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

inline constexpr const char* kDefaultServer = "127.0.0.1:50770";

struct ClientOptions {
    std::string server = kDefaultServer;       // HOST:PORT
    std::chrono::milliseconds timeout{5'000};  // of a call, the connection included
    Security security;                         // none: for a daemon on this machine
};

struct StreamOptions {
    // Connects again, with growing pauses up to 5 s, when the daemon goes away. What was published meanwhile
    // is lost.
    bool reconnect = false;
    std::function<void(const absl::Status& why)> on_reconnect;
    // Ends the stream with DeadlineExceeded after so long without a message; 0: waits for ever.
    std::chrono::milliseconds max_silence{0};
    std::stop_token stop;  // ends the stream with Cancelled, from any thread
};

// One message of StreamVolumes, decoded.
struct VolumeFrame {
    v1::StreamHeader header;
    std::optional<Volume> volume;  // empty while nobody is tracked
    double litres = 0;             // at the capture's own resolution
    std::optional<v1::Subject> subject;
    std::size_t bytes = 0;  // of the volume on the wire
};

// 8 bits a channel, R G B or grey, rows without padding.
struct Image {
    int width = 0, height = 0, channels = 0;
    std::vector<std::uint8_t> data;
};

struct PreviewFrame {
    v1::StreamHeader header;
    std::string camera;
    Image image;  // empty where the camera delivered no picture
};

// Any thread; a stream occupies the thread that called it until it ends. The statuses are the daemon's own;
// Unavailable where it cannot be reached, the message naming the address.
class Client {
  public:
    explicit Client(const ClientOptions& options = {});
    Client(std::shared_ptr<grpc::Channel> channel, const ClientOptions& options = {});
    ~Client();
    Client(Client&&) noexcept;

    absl::StatusOr<v1::GetStatusResponse> status();
    absl::StatusOr<std::vector<Camera>> cameras();

    // Each takes control under `operator_name`, acts and gives control back.
    absl::Status start(const std::string& operator_name);
    absl::Status stop(const std::string& operator_name);
    // `frames` live frame sets, 0: the source's own clip. Waits as long as that takes, `timeout` at most.
    absl::Status learn_background(const std::string& operator_name, int frames,
                                  std::chrono::milliseconds timeout);

    absl::StatusOr<v1::AcquireControlResponse> acquire_control(const v1::AcquireControlRequest& request);
    absl::StatusOr<v1::RenewControlResponse> renew_control(const std::string& lease_id);
    absl::Status release_control(const std::string& lease_id);
    absl::Status start_with(const std::string& lease_id);
    absl::Status stop_with(const std::string& lease_id);
    absl::Status learn_background_with(const std::string& lease_id, int frames,
                                       std::chrono::milliseconds timeout);

    // `on_...` returns whether to go on; false ends the stream with OK.
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

    // The pose database. Changes take control under `operator_name`, act and give control back, as start().
    absl::StatusOr<v1::ListPosesResponse> list_poses();
    absl::StatusOr<v1::AddPoseResponse> add_pose(const std::string& operator_name,
                                                 v1::AddPoseRequest request);
    absl::StatusOr<v1::RemovePoseResponse> remove_pose(const std::string& operator_name,
                                                       v1::RemovePoseRequest request);
    absl::StatusOr<v1::ImportBvhResponse> import_bvh(const std::string& operator_name,
                                                     v1::ImportBvhRequest request);
    absl::Status watch_database(const std::function<bool(const v1::WatchDatabaseResponse&)>& on_progress,
                                const StreamOptions& options);

    // Begins a fit of the subject's body; watch_body() tells the rest.
    absl::Status fit_body(const std::string& operator_name, v1::FitBodyRequest request);
    absl::Status watch_body(const std::function<bool(const v1::WatchBodyResponse&)>& on_progress,
                            const StreamOptions& options);

    // Takes control under `operator_name`, acts and gives control back.
    absl::Status under_control(const std::string& operator_name,
                               const std::function<absl::Status(const std::string& lease_id)>& act);

    // A recording in the place of the cameras. Changes take control under `operator_name` unless the request
    // carries a lease_id already.
    absl::StatusOr<v1::OpenReplayResponse> open_replay(const std::string& operator_name,
                                                       v1::OpenReplayRequest request);
    absl::Status close_replay(const std::string& operator_name);
    absl::StatusOr<v1::SetReplayResponse> set_replay(const std::string& operator_name,
                                                     v1::SetReplayRequest request);
    absl::StatusOr<v1::GetReplayResponse> get_replay();

    // Calibration. Requests that need control carry their lease_id.
    absl::StatusOr<v1::StartProcedureResponse> start_procedure(const v1::StartProcedureRequest& request);
    absl::StatusOr<v1::AddObservationsResponse> add_observations(const v1::AddObservationsRequest& request);
    absl::StatusOr<v1::SolveProcedureResponse> solve_procedure(const v1::SolveProcedureRequest& request);
    absl::StatusOr<v1::CancelProcedureResponse> cancel_procedure(const v1::CancelProcedureRequest& request);
    absl::StatusOr<v1::ListCalibrationsResponse> list_calibrations(
        const v1::ListCalibrationsRequest& request);
    absl::StatusOr<v1::GetCertificateResponse> get_certificate(const v1::GetCertificateRequest& request);
    absl::StatusOr<v1::ApplyCalibrationResponse> apply_calibration(
        const v1::ApplyCalibrationRequest& request);
    absl::StatusOr<v1::UndoCalibrationResponse> undo_calibration(const v1::UndoCalibrationRequest& request);
    absl::StatusOr<v1::ImportCalibrationResponse> import_calibration(
        const v1::ImportCalibrationRequest& request);
    absl::StatusOr<v1::ExportCalibrationResponse> export_calibration(
        const v1::ExportCalibrationRequest& request);
    absl::StatusOr<v1::RemoveCalibrationResponse> remove_calibration(
        const v1::RemoveCalibrationRequest& request);
    absl::Status watch_procedure(const std::function<bool(const v1::WatchProcedureResponse&)>& on_progress,
                                 const StreamOptions& options);

    // Recordings. Changes take control under `operator_name`, act and give control back, as start().
    // `timeout` for those that wait until what is queued is written.
    absl::StatusOr<v1::StartRecordingResponse> start_recording(const std::string& operator_name,
                                                               v1::StartRecordingRequest request);
    absl::StatusOr<v1::StopRecordingResponse> stop_recording(const std::string& operator_name,
                                                             std::chrono::milliseconds timeout);
    absl::StatusOr<v1::KeepLastResponse> keep_last(const std::string& operator_name,
                                                   v1::KeepLastRequest request,
                                                   std::chrono::milliseconds timeout);
    absl::StatusOr<v1::DeleteRecordingResponse> delete_recording(const std::string& operator_name,
                                                                 v1::DeleteRecordingRequest request);
    absl::StatusOr<v1::GetRecorderStatusResponse> recorder_status();
    absl::StatusOr<v1::ListRecordingsResponse> list_recordings();
    absl::StatusOr<v1::GetRecordingResponse> get_recording(const std::string& name);
    // The files' pieces in their order; before the first of them, four times a second, what share of the
    // files is made.
    absl::Status export_recording(v1::ExportRequest request,
                                  const std::function<bool(const v1::ExportResponse&)>& on_piece,
                                  const std::function<void(double share)>& on_progress,
                                  const StreamOptions& options);

  private:
    struct Parts;
    std::unique_ptr<Parts> parts_;
};

Camera camera_from_proto(const v1::Camera& camera);

}  // namespace kinevox::client
