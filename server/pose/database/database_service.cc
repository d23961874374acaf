#include "server/pose/database/database_service.h"

#include <algorithm>
#include <utility>

#include "common/background_priority.h"
#include "server/pose/database/bvh_import.h"

namespace kinevox {
namespace {

constexpr std::size_t kPosesAtOnce = 16;
constexpr const char* kStopping = "the daemon is shutting down; nothing was changed";

}  // namespace

PoseDatabaseService::PoseDatabaseService(std::filesystem::path file, const SearchOptions& options)
    : file_(std::move(file)), options_(options), stature_m_(options.stature_m) {}

PoseDatabaseService::~PoseDatabaseService() {
    close();
    wait();
}

void PoseDatabaseService::close() {
    closed_ = true;
    closing_.request_stop();
    cancel();
}

void PoseDatabaseService::start(std::vector<kernels::CameraModel> cameras, const BodyShape& shape,
                                const PoseDatabaseOptions& options,
                                std::function<void(const DatabaseProgress&)> on_progress) {
    cancel();
    const std::lock_guard changing(changes_);
    if (builder_.joinable()) builder_.join();
    std::stop_source source;
    {
        const std::lock_guard lock(mutex_);
        progress_ = {PoseDatabaseState::kBuilding, 0, {}};
        stop_ = source;
    }
    if (closed_) source.request_stop();  // a later close() stops the new source
    builder_ = std::jthread([this, cameras = std::move(cameras), shape, options, stop = source.get_token(),
                             on_progress = std::move(on_progress)] {
        lower_this_threads_priority();
        build(stop, cameras, shape, options, on_progress);
    });
}

void PoseDatabaseService::build(std::stop_token stop, const std::vector<kernels::CameraModel>& cameras,
                                const BodyShape& shape, const PoseDatabaseOptions& options,
                                const std::function<void(const DatabaseProgress&)>& on_progress) {
    const auto report = [&](DatabaseProgress progress) {
        {
            const std::lock_guard lock(mutex_);
            progress.entry_count = database_ ? database_->entry_count() : 0;
            progress_ = progress;
        }
        if (on_progress) on_progress(progress);
    };
    auto opened = open_pose_database(
        file_, cameras, shape, options,
        [&](double progress) {
            report({PoseDatabaseState::kBuilding, progress, {}});
        },
        stop);
    if (!opened.ok()) {
        const bool cancelled = absl::IsCancelled(opened.status());
        report({cancelled ? PoseDatabaseState::kCancelled : PoseDatabaseState::kFailed, 0,
                std::string(opened.status().message())});
        return;
    }
    auto fresh = std::make_shared<const PoseDatabase>(std::move(opened->database));
    {
        const std::lock_guard lock(mutex_);
        database_ = std::move(fresh);
    }
    report({PoseDatabaseState::kReady, 1, opened->rebuilt_because});
}

void PoseDatabaseService::cancel() {
    const std::lock_guard lock(mutex_);
    stop_.request_stop();
}

void PoseDatabaseService::wait() {
    const std::lock_guard changing(changes_);
    if (builder_.joinable()) builder_.join();
}

DatabaseProgress PoseDatabaseService::progress() const {
    const std::lock_guard lock(mutex_);
    DatabaseProgress progress = progress_;
    progress.entry_count = database_ ? database_->entry_count() : 0;
    return progress;
}

std::shared_ptr<const PoseDatabase> PoseDatabaseService::current() const {
    const std::lock_guard lock(mutex_);
    return database_;
}

absl::StatusOr<std::vector<PoseListing>> PoseDatabaseService::list() const {
    const auto database = current();
    if (!database) return absl::UnavailableError("the pose database is not built yet; try again later");
    std::vector<PoseListing> out;
    for (const LibraryPose& pose : database->poses) out.push_back({pose.label, pose.user_defined});
    return out;
}

absl::Status PoseDatabaseService::change(const std::function<absl::Status(PoseDatabase&)>& how) {
    const std::lock_guard changing(changes_);
    const auto before = current();
    if (!before || progress().state == PoseDatabaseState::kBuilding)
        return absl::UnavailableError("the pose database is being built; try again when it is ready");
    auto after = std::make_shared<PoseDatabase>(*before);
    if (const absl::Status status = how(*after); !status.ok()) return status;
    if (closed_) return absl::UnavailableError(kStopping);
    if (const absl::Status status = write_pose_database(*after, file_); !status.ok()) return status;
    const std::lock_guard lock(mutex_);
    database_ = std::move(after);
    return absl::OkStatus();
}

absl::Status PoseDatabaseService::add(std::span<const LibraryPose> poses) {
    return change([&](PoseDatabase& database) {
        // In batches, so that close() does not wait for a whole file.
        for (std::size_t first = 0; first < poses.size() && !closed_; first += kPosesAtOnce) {
            const auto part = poses.subspan(first, std::min(kPosesAtOnce, poses.size() - first));
            if (const absl::Status status = add_poses(database, part, closing_.get_token()); !status.ok())
                return closed_ ? absl::UnavailableError(kStopping) : status;
        }
        return absl::OkStatus();
    });
}

absl::Status PoseDatabaseService::remove(const std::string& label) {
    return change([&](PoseDatabase& database) { return database.remove(label); });
}

absl::StatusOr<int> PoseDatabaseService::import_bvh(std::string_view text, const std::string& label,
                                                    double interval_s) {
    const auto motion = parse_bvh(text, label);
    if (!motion.ok()) return motion.status();
    const auto poses = poses_from_bvh(*motion, label, {.interval_s = interval_s});
    if (!poses.ok()) return poses.status();
    if (const absl::Status status = add(*poses); !status.ok()) return status;
    return static_cast<int>(poses->size());
}

void PoseDatabaseService::set_stature(double stature_m) {
    const std::lock_guard lock(mutex_);
    stature_m_ = stature_m;
}

std::vector<PoseCandidate> PoseDatabaseService::propose(std::span<const PoseView> views, Vec3 centre_in_world,
                                                        int max_candidates) {
    std::shared_ptr<const PoseDatabase> database;
    double stature_m = 0;
    {
        const std::lock_guard lock(mutex_);
        database = database_;
        stature_m = stature_m_;
    }
    if (!database) return {};
    const std::lock_guard lock(searching_);
    if (database != searched_ || stature_m != options_.stature_m) {
        options_.stature_m = stature_m;
        search_ = std::make_unique<DatabaseSearch>(*database, options_);
        searched_ = database;
    }
    return search_->propose(views, centre_in_world, max_candidates);
}

}  // namespace kinevox
