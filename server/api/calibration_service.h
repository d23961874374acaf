// CalibrationService on gRPC's callback API hands each call to its handler on the right thread. Handlers, one
// function per method: check, act, translate. Those that access files run on the thread for calibrations,
// those that change the active calibration on the control thread; all after check_calibration().
#pragma once

#include <absl/status/status.h>

#include "kinevox/v1/calibration_service.grpc.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

// FailedPrecondition if this daemon does not support calibration.
absl::Status check_calibration(const ApiContext& api);

absl::Status start_procedure(const ApiContext& api, const v1::StartProcedureRequest& request,
                             v1::StartProcedureResponse& response);
absl::Status add_observations(const ApiContext& api, const v1::AddObservationsRequest& request,
                              v1::AddObservationsResponse& response);
absl::Status solve_procedure(const ApiContext& api, const v1::SolveProcedureRequest& request,
                             v1::SolveProcedureResponse& response);
absl::Status cancel_procedure(const ApiContext& api, const v1::CancelProcedureRequest& request,
                              v1::CancelProcedureResponse& response);
v1::WatchProcedureResponse to_proto(const ProcedureProgress& progress);

absl::Status list_calibrations(const ApiContext& api, const v1::ListCalibrationsRequest& request,
                               v1::ListCalibrationsResponse& response);
absl::Status get_certificate(const ApiContext& api, const v1::GetCertificateRequest& request,
                             v1::GetCertificateResponse& response);
absl::Status apply_calibration(const ApiContext& api, const v1::ApplyCalibrationRequest& request,
                               v1::ApplyCalibrationResponse& response);
absl::Status undo_calibration(const ApiContext& api, const v1::UndoCalibrationRequest& request,
                              v1::UndoCalibrationResponse& response);
absl::Status import_calibration(const ApiContext& api, const v1::ImportCalibrationRequest& request,
                                v1::ImportCalibrationResponse& response);
absl::Status export_calibration(const ApiContext& api, const v1::ExportCalibrationRequest& request,
                                v1::ExportCalibrationResponse& response);
absl::Status delete_calibration(const ApiContext& api, const v1::DeleteCalibrationRequest& request,
                                v1::DeleteCalibrationResponse& response);

class CalibrationServiceImpl final : public v1::CalibrationService::CallbackService {
  public:
    explicit CalibrationServiceImpl(const ApiContext& api) : api_(api) {}

    using Context = grpc::CallbackServerContext;
    using Reactor = grpc::ServerUnaryReactor;
    Reactor* StartProcedure(Context*, const v1::StartProcedureRequest*, v1::StartProcedureResponse*) override;
    Reactor* AddObservations(Context*, const v1::AddObservationsRequest*,
                             v1::AddObservationsResponse*) override;
    Reactor* SolveProcedure(Context*, const v1::SolveProcedureRequest*, v1::SolveProcedureResponse*) override;
    Reactor* CancelProcedure(Context*, const v1::CancelProcedureRequest*,
                             v1::CancelProcedureResponse*) override;
    grpc::ServerWriteReactor<v1::WatchProcedureResponse>* WatchProcedure(
        Context*, const v1::WatchProcedureRequest*) override;
    Reactor* ListCalibrations(Context*, const v1::ListCalibrationsRequest*,
                              v1::ListCalibrationsResponse*) override;
    Reactor* GetCertificate(Context*, const v1::GetCertificateRequest*, v1::GetCertificateResponse*) override;
    Reactor* ApplyCalibration(Context*, const v1::ApplyCalibrationRequest*,
                              v1::ApplyCalibrationResponse*) override;
    Reactor* UndoCalibration(Context*, const v1::UndoCalibrationRequest*,
                             v1::UndoCalibrationResponse*) override;
    Reactor* ImportCalibration(Context*, const v1::ImportCalibrationRequest*,
                               v1::ImportCalibrationResponse*) override;
    Reactor* ExportCalibration(Context*, const v1::ExportCalibrationRequest*,
                               v1::ExportCalibrationResponse*) override;
    Reactor* DeleteCalibration(Context*, const v1::DeleteCalibrationRequest*,
                               v1::DeleteCalibrationResponse*) override;

  private:
    const ApiContext& api_;
};

}  // namespace kinevox
