// CalibrationService on gRPC's callback API: hands each call to its handler on the right thread.
#pragma once

#include "kinevox/v1/calibration_service.grpc.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

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
