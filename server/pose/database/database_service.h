// The pose database of a running daemon: built in the background after a calibration, queried by the pose
// stage, changed by users.
//
// Threads: the pose stage's thread calls propose(), any thread the others. The callback comes from the
// building thread and must not call back into this class, except progress().
#pragma once

#include <atomic>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <stop_token>
#include <string>
#include <thread>
#include <vector>

#include "server/pose/database/database_file.h"
#include "server/pose/database/database_search.h"

namespace kinevox {

enum class PoseDatabaseState { kNotStarted, kBuilding, kReady, kCancelled, kFailed };

struct DatabaseProgress {
    PoseDatabaseState state = PoseDatabaseState::kNotStarted;
    double progress = 0;           // of the build, 0..1
    std::string message;           // why it was built, or the error; one line
    std::int64_t entry_count = 0;  // of the database that is used meanwhile
};

struct PoseListing {
    std::string label;
    bool user_defined = false;
};

class PoseDatabaseService final : public PoseProposer {
  public:
    explicit PoseDatabaseService(std::filesystem::path file, const SearchOptions& options = {});
    ~PoseDatabaseService() override;  // cancels and waits

    // Reads or builds, at low priority; cancels a running build. Until it is done the previous database is
    // used, if there is one.
    void start(std::vector<kernels::CameraModel> cameras, const BodyShape& shape,
               const PoseDatabaseOptions& options,
               std::function<void(const DatabaseProgress&)> on_progress = {});
    void cancel();
    // Waits until no build is running.
    void wait();
    // For shutdown: cancels a running build or change; nothing is built or changed afterwards.
    void close();
    DatabaseProgress progress() const;

    // Unavailable without a database. Changes take effect after they are written to the file; they take about
    // 20 ms per pose and the time to write the file.
    absl::StatusOr<std::vector<PoseListing>> list() const;
    absl::Status add(std::span<const LibraryPose> poses);
    absl::Status remove(const std::string& label);
    // Imports a pose every `interval_s` seconds from the text of a BVH file. Returns their number.
    absl::StatusOr<int> import_bvh(std::string_view text, const std::string& label, double interval_s = 0.1);

    // The subject's stature, if it differs from the database's body.
    void set_stature(double stature_m);
    std::vector<PoseCandidate> propose(std::span<const PoseView> views, Vec3 centre_in_world,
                                       int max_candidates) override;

  private:
    std::shared_ptr<const PoseDatabase> current() const;
    void build(std::stop_token stop, const std::vector<kernels::CameraModel>& cameras, const BodyShape& shape,
               const PoseDatabaseOptions& options,
               const std::function<void(const DatabaseProgress&)>& on_progress);
    absl::Status change(const std::function<absl::Status(PoseDatabase&)>& how);

    const std::filesystem::path file_;
    SearchOptions options_;
    mutable std::mutex mutex_;
    std::mutex changes_;     // serialises start(), wait() and changes
    std::stop_source stop_;  // of the running build
    std::atomic<bool> closed_ = false;
    std::stop_source closing_;  // of a running change
    std::shared_ptr<const PoseDatabase> database_;
    DatabaseProgress progress_;
    double stature_m_ = 0;
    // Used by propose() only, one call at a time.
    std::mutex searching_;
    std::shared_ptr<const PoseDatabase> searched_;
    std::unique_ptr<DatabaseSearch> search_;
    std::jthread builder_;
};

}  // namespace kinevox
