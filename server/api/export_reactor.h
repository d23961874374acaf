// The gRPC side of one export: the exports' thread creates the files, then sends them in chunks. Progress
// messages are sent on request while the files are created.
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

// Owns itself from run() to gRPC's OnDone. Its state belongs to the exports' thread; one write is in flight,
// so a slow client costs the memory of one chunk.
class ExportReactor final : public grpc::ServerWriteReactor<v1::ExportRecordingResponse>,
                            public std::enable_shared_from_this<ExportReactor> {
  public:
    static ExportReactor* run(const ApiContext& api, grpc::CallbackServerContext* context,
                              const v1::ExportRecordingRequest& request);
    void OnWriteDone(bool ok) override;
    void OnCancel() override { stop_ = true; }
    void OnDone() override;

  private:
    explicit ExportReactor(const ApiContext& api) : api_(api) {}
    absl::Status register_stream(grpc::CallbackServerContext* context);
    void create_files(const v1::ExportRecordingRequest& request);
    void report(double progress);
    absl::StatusOr<ExportedFiles> files_of(const v1::ExportRecordingRequest& request);
    void send_next();
    void finish(const grpc::Status& status);

    // The write in flight. Progress is written while the files are created; the first chunk waits for it.
    enum class Writing { kNothing, kProgress, kChunks };

    const ApiContext& api_;
    std::shared_ptr<ExportReactor> self_;  // until OnDone
    std::atomic<bool> stop_ = false;
    std::atomic<bool> revoked_ = false;  // by the guard, which also sets stop_
    std::shared_ptr<Guard::Stream> counted_;
    std::atomic<Writing> writing_ = Writing::kNothing;
    std::chrono::steady_clock::time_point next_report_;
    std::filesystem::path folder_;
    absl::StatusOr<ExportedFiles> files_;  // since create_files()
    std::size_t file_index_ = 0;
    std::ifstream file_;
    v1::ExportRecordingResponse chunk_;  // must live until OnWriteDone
};

}  // namespace kinevox
