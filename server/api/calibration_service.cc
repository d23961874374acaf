#include "server/api/calibration_service.h"

#include <boost/asio/post.hpp>

#include "server/api/calibration_handlers.h"
#include "server/api/stream_reactor.h"
#include "server/api/to_proto.h"

namespace kinevox {

using ProcedureReactor = StreamReactor<ProcedureWatch::Box, v1::WatchProcedureResponse>;

// gRPC keeps request and response until Finish().
template <typename Request, typename Response>
CalibrationServiceImpl::Reactor* CalibrationServiceImpl::on(const boost::asio::any_io_executor& thread,
                                                            Context* context, const Request* request,
                                                            Response* response,
                                                            absl::Status (*handler)(const ApiContext&, const Request&,
                                                                                    Response&)) {
    Reactor* reactor = context->DefaultReactor();
    if (const absl::Status missing = check_calibration(api_); !missing.ok()) {
        reactor->Finish(to_grpc(missing));
        return reactor;
    }
    boost::asio::post(thread, [this, reactor, request, response, handler] {
        reactor->Finish(to_grpc(handler(api_, *request, *response)));
    });
    return reactor;
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::StartProcedure(Context* context, const v1::StartProcedureRequest* request,
    v1::StartProcedureResponse* response) {
    return on(api_.calibrating, context, request, response, start_procedure);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::AddObservations(Context* context, const v1::AddObservationsRequest* request,
    v1::AddObservationsResponse* response) {
    return on(api_.calibrating, context, request, response, add_observations);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::SolveProcedure(Context* context, const v1::SolveProcedureRequest* request,
    v1::SolveProcedureResponse* response) {
    return on(api_.calibrating, context, request, response, solve_procedure);
}

// Not behind a call that reads files.
CalibrationServiceImpl::Reactor* CalibrationServiceImpl::CancelProcedure(Context* context, const v1::CancelProcedureRequest* request,
    v1::CancelProcedureResponse* response) {
    Reactor* reactor = context->DefaultReactor();
    const absl::Status missing = check_calibration(api_);
    reactor->Finish(to_grpc(missing.ok() ? cancel_procedure(api_, *request, *response) : missing));
    return reactor;
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::ListCalibrations(Context* context, const v1::ListCalibrationsRequest* request,
    v1::ListCalibrationsResponse* response) {
    return on(api_.calibrating, context, request, response, list_calibrations);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::GetCertificate(Context* context, const v1::GetCertificateRequest* request,
    v1::GetCertificateResponse* response) {
    return on(api_.calibrating, context, request, response, get_certificate);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::ApplyCalibration(Context* context, const v1::ApplyCalibrationRequest* request,
    v1::ApplyCalibrationResponse* response) {
    return on(api_.control, context, request, response, apply_calibration);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::UndoCalibration(Context* context, const v1::UndoCalibrationRequest* request,
    v1::UndoCalibrationResponse* response) {
    return on(api_.control, context, request, response, undo_calibration);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::ImportCalibration(Context* context, const v1::ImportCalibrationRequest* request,
    v1::ImportCalibrationResponse* response) {
    return on(api_.calibrating, context, request, response, import_calibration);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::ExportCalibration(Context* context, const v1::ExportCalibrationRequest* request,
    v1::ExportCalibrationResponse* response) {
    return on(api_.calibrating, context, request, response, export_calibration);
}

CalibrationServiceImpl::Reactor* CalibrationServiceImpl::RemoveCalibration(Context* context, const v1::RemoveCalibrationRequest* request,
    v1::RemoveCalibrationResponse* response) {
    return on(api_.calibrating, context, request, response, remove_calibration);
}

grpc::ServerWriteReactor<v1::WatchProcedureResponse>* CalibrationServiceImpl::WatchProcedure(
    Context*, const v1::WatchProcedureRequest*) {
    if (const absl::Status missing = check_calibration(api_); !missing.ok())
        return ProcedureReactor::refuse(api_, to_grpc(missing));
    return ProcedureReactor::run(
        api_, 0, [this](std::function<void()> on_ready) { return api_.procedure_watch->subscribe(std::move(on_ready)); },
        [](const ProcedureWatch::Box::Taken& taken) { return to_proto(taken.message); });
}

}  // namespace kinevox
