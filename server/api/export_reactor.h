// The gRPC side of one export: the files are made on the exports' thread, then sent piece by piece; who asks
// for it is told meanwhile how far that is.
#pragma once

#include <grpcpp/support/server_callback.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <memory>

#include "kinevox/v1/recording_service.pb.h"
#include "server/access/guard.h"
#include "server/api/api_context.h"
#include "server/recording/recording_export.h"

namespace kinevox {

// Owns itself from run() to gRPC's OnDone. The state below is the exports' thread's; one write is in flight,
// so a client that reads slowly costs a piece.
class ExportReactor final : public grpc::ServerWriteReactor<v1::ExportResponse>,
                            public std::enable_shared_from_this<ExportReactor> {
  public:
    static ExportReactor* run(const ApiContext& api, grpc::CallbackServerContext* context,
                              const v1::ExportRequest& request);
    void OnWriteDone(bool ok) override;
    void OnCancel() override { stop_ = true; }
    void OnDone() override;

  private:
    explicit ExportReactor(const ApiContext& api) : api_(api) {}
    absl::Status be_counted(grpc::CallbackServerContext* context);
    void make(const v1::ExportRequest& request);
    void tell(double share);
    absl::StatusOr<ExportedFiles> make_files(const v1::ExportRequest& request);
    void send_next();
    void finish(const grpc::Status& status);

    // What is being written. Words go while the files are made; the first piece waits for the last word.
    enum class Writing { kNothing, kWord, kPieces };

    const ApiContext& api_;
    std::shared_ptr<ExportReactor> self_;  // until OnDone
    std::atomic<bool> stop_ = false;
    std::atomic<bool> revoked_ = false;  // by the guard, which stops it too
    std::shared_ptr<Guard::Stream> counted_;
    std::atomic<Writing> writing_ = Writing::kNothing;
    std::chrono::steady_clock::time_point next_word_;
    std::filesystem::path folder_;
    absl::StatusOr<ExportedFiles> made_;  // since make()
    std::size_t at_ = 0;                  // of its files
    std::ifstream file_;
    v1::ExportResponse piece_;  // must live until OnWriteDone
};

}  // namespace kinevox
