#include "server/api/calibration_service.h"

#include "server/api/call.h"
#include "server/api/stream_reactor.h"
#include "server/api/to_proto.h"

namespace kinevox {

using ProcedureReactor = StreamReactor<ProcedureWatch::Box, v1::WatchProcedureResponse>;

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::StartProcedure(
    Context* context, const v1::StartProcedureRequest* request, v1::StartProcedureResponse* response) {
    return unary_call(api_, api_.threads.calibrating, context, request, response, check_calibration,
                      start_procedure);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::AddObservations(
    Context* context, const v1::AddObservationsRequest* request, v1::AddObservationsResponse* response) {
    return unary_call(api_, api_.threads.calibrating, context, request, response, check_calibration,
                      add_observations);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::SolveProcedure(
    Context* context, const v1::SolveProcedureRequest* request, v1::SolveProcedureResponse* response) {
    return unary_call(api_, api_.threads.calibrating, context, request, response, check_calibration,
                      solve_procedure);
}

// Must not queue behind a call that reads files.
CalibrationServiceImpl::Reactor* CalibrationServiceImpl::CancelProcedure(
    Context* context, const v1::CancelProcedureRequest* request, v1::CancelProcedureResponse* response) {
    const absl::Status missing = check_calibration(api_);
    return answer(context, missing.ok() ? cancel_procedure(api_, *request, *response) : missing);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::ListCalibrations(
    Context* context, const v1::ListCalibrationsRequest* request, v1::ListCalibrationsResponse* response) {
    return unary_call(api_, api_.threads.calibrating, context, request, response, check_calibration,
                      list_calibrations);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::GetCertificate(
    Context* context, const v1::GetCertificateRequest* request, v1::GetCertificateResponse* response) {
    return unary_call(api_, api_.threads.calibrating, context, request, response, check_calibration,
                      get_certificate);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::ApplyCalibration(
    Context* context, const v1::ApplyCalibrationRequest* request, v1::ApplyCalibrationResponse* response) {
    return unary_call(api_, api_.threads.control, context, request, response, check_calibration,
                      apply_calibration);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::UndoCalibration(
    Context* context, const v1::UndoCalibrationRequest* request, v1::UndoCalibrationResponse* response) {
    return unary_call(api_, api_.threads.control, context, request, response, check_calibration,
                      undo_calibration);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::ImportCalibration(
    Context* context, const v1::ImportCalibrationRequest* request, v1::ImportCalibrationResponse* response) {
    return unary_call(api_, api_.threads.calibrating, context, request, response, check_calibration,
                      import_calibration);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::ExportCalibration(
    Context* context, const v1::ExportCalibrationRequest* request, v1::ExportCalibrationResponse* response) {
    return unary_call(api_, api_.threads.calibrating, context, request, response, check_calibration,
                      export_calibration);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::DeleteCalibration(
    Context* context, const v1::DeleteCalibrationRequest* request, v1::DeleteCalibrationResponse* response) {
    return unary_call(api_, api_.threads.calibrating, context, request, response, check_calibration,
                      delete_calibration);
}

grpc::ServerWriteReactor<v1::WatchProcedureResponse>* CalibrationServiceImpl::WatchProcedure(
    Context* context, const v1::WatchProcedureRequest*) {
    if (const absl::Status missing = check_calibration(api_); !missing.ok())
        return ProcedureReactor::refuse(api_, to_grpc(missing));
    return ProcedureReactor::run(
        api_, context, {},
        [this](std::function<void()> on_ready) {
            return api_.calibration.procedure_watch->subscribe(std::move(on_ready));
        },
        [](const ProcedureWatch::Box::Taken& taken) { return to_proto(taken.message); });
}

}  // namespace kinevox
