// The pose database of a running daemon: built in the background after a calibration, asked by the pose
// stage, changed by users.
//
// Threads: propose() and place in one thread (the pose stage's), everything else in any. The callback comes
// from the building thread and must not call back into this class, except progress().
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

enum class DatabaseState { kNone, kBuilding, kReady, kCancelled, kFailed };

struct DatabaseProgress {
    DatabaseState state = DatabaseState::kNone;
    double part = 0;           // of the building, 0..1
    std::string message;       // why it was built, or what went wrong; one line
    std::int64_t entries = 0;  // of the database that answers meanwhile
};

struct PoseListing {
    std::string label;
    bool added = false;  // by a user
};

class PoseDatabaseService final : public PoseProposer {
  public:
    explicit PoseDatabaseService(std::filesystem::path file, const SearchOptions& options = {});
    ~PoseDatabaseService() override;  // cancels and waits

    // Reads or builds, at low priority; a build that is under way is cancelled. Until it is done the database
    // of before answers, if there is one.
    void start(std::vector<kernels::CameraModel> cameras, const BodyShape& shape,
               const PoseDatabaseOptions& options,
               std::function<void(const DatabaseProgress&)> on_progress = {});
    void cancel();
    // Until nothing is being built.
    void wait();
    // For the daemon's end: cancels a build and a change in progress; nothing is built or changed afterwards.
    void close();
    DatabaseProgress progress() const;

    // Unavailable while there is no database. Changes are written to the file before they count; they take
    // about 20 ms a pose and the time to write the file.
    absl::StatusOr<std::vector<PoseListing>> list() const;
    absl::Status add(std::span<const LibraryPose> poses);
    absl::Status remove(const std::string& label);
    // Every `every_s` seconds' pose of a BVH file's text. Returns how many there were.
    absl::StatusOr<int> import_bvh(std::string_view text, const std::string& label, double every_s = 0.1);

    // Of another stature than the database's body.
    void set_stature(double stature_m);
    std::vector<PoseCandidate> propose(std::span<const PoseView> views, Vec3 centre_in_world,
                                       int most) override;

  private:
    std::shared_ptr<const PoseDatabase> current() const;
    void build(std::stop_token stop, const std::vector<kernels::CameraModel>& cameras, const BodyShape& shape,
               const PoseDatabaseOptions& options,
               const std::function<void(const DatabaseProgress&)>& on_progress);
    absl::Status change(const std::function<absl::Status(PoseDatabase&)>& how);

    const std::filesystem::path file_;
    SearchOptions options_;
    mutable std::mutex mutex_;
    std::mutex changes_;     // one start(), wait() or change at a time
    std::stop_source stop_;  // of the build under way
    std::atomic<bool> closed_ = false;
    std::stop_source closing_;  // of a change in progress
    std::shared_ptr<const PoseDatabase> database_;
    DatabaseProgress progress_;
    double stature_m_ = 0;
    // Of propose() alone.
    std::shared_ptr<const PoseDatabase> searched_;
    std::unique_ptr<DatabaseSearch> search_;
    std::jthread builder_;
};

}  // namespace kinevox
