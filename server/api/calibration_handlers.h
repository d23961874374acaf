// Handlers of CalibrationService, one function per method: check, act, translate. Those that access files run
// on the thread for calibrations, those that change the active calibration on the control thread; all after
// check_calibration().
#pragma once

#include <absl/status/status.h>

#include "kinevox/v1/calibration_service.pb.h"
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

}  // namespace kinevox
