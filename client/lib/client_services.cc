// Client's calls about subjects, and of the pose, replay, calibration and recording services.
#include "client/lib/client_parts.h"

namespace kinevox::client {

absl::StatusOr<v1::ListSubjectsResponse> Client::list_subjects() {
    return parts_->call_all_pages(*parts_->capture, &v1::CaptureService::Stub::ListSubjects,
                                  v1::ListSubjectsRequest());
}

absl::Status Client::select_subjects(const std::string& operator_name, v1::SelectSubjectsRequest request) {
    return change_under_control<v1::SelectSubjectsResponse>(
               *this, operator_name, request,
               [&] {
                   return parts_->call(*parts_->capture, &v1::CaptureService::Stub::SelectSubjects, request);
               })
        .status();
}

absl::Status Client::name_subject(const std::string& operator_name, v1::NameSubjectRequest request) {
    return change_under_control<v1::NameSubjectResponse>(
               *this, operator_name, request,
               [&] {
                   return parts_->call(*parts_->capture, &v1::CaptureService::Stub::NameSubject, request);
               })
        .status();
}

absl::StatusOr<v1::ListLibraryPosesResponse> Client::list_library_poses() {
    return parts_->call_all_pages(*parts_->pose, &v1::PoseService::Stub::ListLibraryPoses,
                                  v1::ListLibraryPosesRequest());
}

absl::StatusOr<v1::AddLibraryPoseResponse> Client::add_library_pose(const std::string& operator_name,
                                                                    v1::AddLibraryPoseRequest request) {
    return change_under_control<v1::AddLibraryPoseResponse>(*this, operator_name, request, [&] {
        return parts_->call(*parts_->pose, &v1::PoseService::Stub::AddLibraryPose, request, kChangeTimeout);
    });
}

absl::StatusOr<v1::DeleteLibraryPoseResponse> Client::delete_library_pose(
    const std::string& operator_name, v1::DeleteLibraryPoseRequest request) {
    return change_under_control<v1::DeleteLibraryPoseResponse>(*this, operator_name, request, [&] {
        return parts_->call(*parts_->pose, &v1::PoseService::Stub::DeleteLibraryPose, request,
                            kChangeTimeout);
    });
}

absl::StatusOr<v1::ImportLibraryPosesResponse> Client::import_library_poses(
    const std::string& operator_name, v1::ImportLibraryPosesRequest request) {
    return change_under_control<v1::ImportLibraryPosesResponse>(*this, operator_name, request, [&] {
        return parts_->call(*parts_->pose, &v1::PoseService::Stub::ImportLibraryPoses, request,
                            kChangeTimeout);
    });
}

absl::Status Client::watch_pose_database(
    const std::function<bool(const v1::WatchPoseDatabaseResponse&)>& on_progress,
    const StreamOptions& options) {
    return parts_->read(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->pose->PrepareAsyncWatchPoseDatabase(context, v1::WatchPoseDatabaseRequest(),
                                                               queue);
        },
        on_progress, options);
}

absl::Status Client::fit_body(const std::string& operator_name, v1::FitBodyRequest request) {
    return change_under_control<v1::FitBodyResponse>(
               *this, operator_name, request,
               [&] { return parts_->call(*parts_->pose, &v1::PoseService::Stub::FitBody, request); })
        .status();
}

absl::Status Client::watch_body(const std::function<bool(const v1::WatchBodyResponse&)>& on_progress,
                                const StreamOptions& options) {
    return parts_->read(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->pose->PrepareAsyncWatchBody(context, v1::WatchBodyRequest(), queue);
        },
        on_progress, options);
}

absl::StatusOr<v1::OpenReplayResponse> Client::open_replay(const std::string& operator_name,
                                                           v1::OpenReplayRequest request) {
    return change_under_control<v1::OpenReplayResponse>(
        *this, operator_name, request,
        [&] {
            return parts_->call(*parts_->replay, &v1::ReplayService::Stub::OpenReplay, request,
                                kChangeTimeout);
        },
        true);
}

absl::Status Client::close_replay(const std::string& operator_name) {
    v1::CloseReplayRequest request;
    return change_under_control<v1::CloseReplayResponse>(
               *this, operator_name, request,
               [&] {
                   return parts_->call(*parts_->replay, &v1::ReplayService::Stub::CloseReplay, request,
                                       kChangeTimeout);
               })
        .status();
}

absl::StatusOr<v1::UpdateReplayResponse> Client::update_replay(const std::string& operator_name,
                                                               v1::UpdateReplayRequest request) {
    return change_under_control<v1::UpdateReplayResponse>(
        *this, operator_name, request,
        [&] { return parts_->call(*parts_->replay, &v1::ReplayService::Stub::UpdateReplay, request); }, true);
}

absl::StatusOr<v1::GetReplayResponse> Client::get_replay() {
    return parts_->call(*parts_->replay, &v1::ReplayService::Stub::GetReplay, v1::GetReplayRequest());
}

absl::StatusOr<v1::StartProcedureResponse> Client::start_procedure(const v1::StartProcedureRequest& request) {
    return parts_->call(*parts_->calibration, &v1::CalibrationService::Stub::StartProcedure, request);
}

absl::StatusOr<v1::AddObservationsResponse> Client::add_observations(
    const v1::AddObservationsRequest& request) {
    return parts_->call(*parts_->calibration, &v1::CalibrationService::Stub::AddObservations, request);
}

absl::StatusOr<v1::SolveProcedureResponse> Client::solve_procedure(const v1::SolveProcedureRequest& request) {
    return parts_->call(*parts_->calibration, &v1::CalibrationService::Stub::SolveProcedure, request);
}

absl::StatusOr<v1::CancelProcedureResponse> Client::cancel_procedure(
    const v1::CancelProcedureRequest& request) {
    return parts_->call(*parts_->calibration, &v1::CalibrationService::Stub::CancelProcedure, request);
}

absl::StatusOr<v1::ListCalibrationsResponse> Client::list_calibrations(v1::ListCalibrationsRequest request) {
    return parts_->call_all_pages(*parts_->calibration, &v1::CalibrationService::Stub::ListCalibrations,
                                  std::move(request));
}

absl::StatusOr<v1::GetCertificateResponse> Client::get_certificate(const v1::GetCertificateRequest& request) {
    return parts_->call(*parts_->calibration, &v1::CalibrationService::Stub::GetCertificate, request,
                        request.include_page() ? kChangeTimeout : parts_->options.timeout);
}

absl::StatusOr<v1::ApplyCalibrationResponse> Client::apply_calibration(
    const v1::ApplyCalibrationRequest& request) {
    return parts_->call(*parts_->calibration, &v1::CalibrationService::Stub::ApplyCalibration, request,
                        kChangeTimeout);
}

absl::StatusOr<v1::UndoCalibrationResponse> Client::undo_calibration(
    const v1::UndoCalibrationRequest& request) {
    return parts_->call(*parts_->calibration, &v1::CalibrationService::Stub::UndoCalibration, request,
                        kChangeTimeout);
}

absl::StatusOr<v1::ImportCalibrationResponse> Client::import_calibration(
    const v1::ImportCalibrationRequest& request) {
    return parts_->call(*parts_->calibration, &v1::CalibrationService::Stub::ImportCalibration, request);
}

absl::StatusOr<v1::ExportCalibrationResponse> Client::export_calibration(
    const v1::ExportCalibrationRequest& request) {
    return parts_->call(*parts_->calibration, &v1::CalibrationService::Stub::ExportCalibration, request);
}

absl::StatusOr<v1::DeleteCalibrationResponse> Client::delete_calibration(
    const v1::DeleteCalibrationRequest& request) {
    return parts_->call(*parts_->calibration, &v1::CalibrationService::Stub::DeleteCalibration, request);
}

absl::Status Client::watch_procedure(
    const std::function<bool(const v1::WatchProcedureResponse&)>& on_progress, const StreamOptions& options) {
    return parts_->read(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->calibration->PrepareAsyncWatchProcedure(context, v1::WatchProcedureRequest(),
                                                                   queue);
        },
        on_progress, options);
}

absl::StatusOr<v1::StartRecordingResponse> Client::start_recording(const std::string& operator_name,
                                                                   v1::StartRecordingRequest request) {
    return change_under_control<v1::StartRecordingResponse>(*this, operator_name, request, [&] {
        return parts_->call(*parts_->recording, &v1::RecordingService::Stub::StartRecording, request,
                            std::chrono::seconds(30));
    });
}

absl::StatusOr<v1::StopRecordingResponse> Client::stop_recording(const std::string& operator_name,
                                                                 std::chrono::milliseconds timeout) {
    v1::StopRecordingRequest request;
    return change_under_control<v1::StopRecordingResponse>(*this, operator_name, request, [&] {
        return parts_->call(*parts_->recording, &v1::RecordingService::Stub::StopRecording, request, timeout);
    });
}

absl::StatusOr<v1::SaveBufferResponse> Client::save_buffer(const std::string& operator_name,
                                                           v1::SaveBufferRequest request,
                                                           std::chrono::milliseconds timeout) {
    return change_under_control<v1::SaveBufferResponse>(*this, operator_name, request, [&] {
        return parts_->call(*parts_->recording, &v1::RecordingService::Stub::SaveBuffer, request, timeout);
    });
}

absl::StatusOr<v1::DeleteRecordingResponse> Client::delete_recording(const std::string& operator_name,
                                                                     v1::DeleteRecordingRequest request) {
    return change_under_control<v1::DeleteRecordingResponse>(*this, operator_name, request, [&] {
        return parts_->call(*parts_->recording, &v1::RecordingService::Stub::DeleteRecording, request,
                            std::chrono::seconds(30));
    });
}

absl::StatusOr<v1::GetRecorderStatusResponse> Client::recorder_status() {
    return parts_->call(*parts_->recording, &v1::RecordingService::Stub::GetRecorderStatus,
                        v1::GetRecorderStatusRequest());
}

absl::StatusOr<v1::ListRecordingsResponse> Client::list_recordings() {
    return parts_->call_all_pages(*parts_->recording, &v1::RecordingService::Stub::ListRecordings,
                                  v1::ListRecordingsRequest());
}

absl::StatusOr<v1::GetRecordingResponse> Client::get_recording(const std::string& name) {
    v1::GetRecordingRequest request;
    request.set_name(name);
    return parts_->call(*parts_->recording, &v1::RecordingService::Stub::GetRecording, request);
}

absl::Status Client::export_recording(v1::ExportRecordingRequest request,
                                      const std::function<bool(const v1::ExportRecordingResponse&)>& on_chunk,
                                      const std::function<void(double progress)>& on_progress,
                                      const StreamOptions& options) {
    request.set_report_progress(true);
    return read_stream<v1::ExportRecordingResponse>(
        [&](grpc::ClientContext* context, grpc::CompletionQueue* queue) {
            return parts_->recording->PrepareAsyncExportRecording(context, request, queue);
        },
        [&](const v1::ExportRecordingResponse& chunk) -> absl::StatusOr<bool> {
            if (!chunk.file_name().empty()) return on_chunk(chunk);
            on_progress(chunk.progress());
            return true;
        },
        options, parts_->options);
}

}  // namespace kinevox::client
