#include "server/tools/process/result_writer.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <condition_variable>
#include <deque>
#include <iterator>
#include <mutex>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <optional>
#include <system_error>
#include <thread>
#include <utility>

#include "common/background_priority.h"
#include "common/files.h"
#include "common/volume.h"
#include "server/cameras/image_mat.h"
#include "server/recording/subject_names.h"

namespace kinevox {
namespace {

enum TableIndex { kVolume, kTiming, kTrack, kSilhouetteIou, kEvents };

// The box around the occupied voxels, m.
struct Extent {
    Vec3 min_in_world, max_in_world;
};

std::optional<Extent> extent_of(const Volume& volume) {
    constexpr int kNone = 1 << 30;
    int low[3] = {kNone, kNone, kNone}, high[3] = {-kNone, -kNone, -kNone};  // voxels, half open
    const auto include = [&](int axis, int first, int last) {
        low[axis] = std::min(low[axis], first);
        high[axis] = std::max(high[axis], last);
    };
    for (const VolumeBrick& brick : volume.bricks) {
        std::uint64_t layers = 0;
        for (int z = 0; z < 8; ++z) {
            if (brick.occupancy[z] == 0) continue;
            layers |= brick.occupancy[z];
            include(2, 8 * brick.z + z, 8 * brick.z + z + 1);
        }
        if (layers == 0) continue;
        include(1, 8 * brick.y + std::countr_zero(layers) / 8,
                8 * brick.y + 8 - std::countl_zero(layers) / 8);
        std::uint64_t columns = layers | layers >> 32;
        columns |= columns >> 16;
        columns = (columns | columns >> 8) & 0xff;
        include(0, 8 * brick.x + std::countr_zero(columns), 8 * brick.x + 64 - std::countl_zero(columns));
    }
    if (low[0] == kNone) return std::nullopt;
    const Vec3 o = volume.grid.origin_in_world;
    const double edge = volume.grid.voxel_m;
    return Extent{{o.x + edge * low[0], o.y + edge * low[1], o.z + edge * low[2]},
                  {o.x + edge * high[0], o.y + edge * high[1], o.z + edge * high[2]}};
}

template <class... T>
void append(std::string& to, fmt::format_string<T...> format, T&&... values) {
    fmt::format_to(std::back_inserter(to), format, std::forward<T>(values)...);
}

std::string subject_cell(std::uint32_t subject_id) {
    return subject_id ? fmt::to_string(subject_id) : "";
}

namespace fs = std::filesystem;

constexpr std::string_view kPartial = ".kinevox-partial";

std::string six_digits(std::uint64_t frame, std::string_view ending) {
    return fmt::format("{:06d}{}", frame, ending);
}

absl::Status cannot_write(const fs::path& file, std::string_view why) {
    return absl::InternalError(
        fmt::format("{} cannot be written ({}); check free space and permissions", file.string(), why));
}

class FolderWriter final : public ResultWriter {
  public:
    FolderWriter(fs::path folder, std::vector<std::string> names, const ResultWriterOptions& options)
        : folder_(std::move(folder)),
          partial_(folder_ / kPartial),
          names_(std::move(names)),
          options_(options) {}

    ~FolderWriter() override {
        {
            const std::lock_guard lock(mutex_);
            waiting_.clear();
        }
        end_threads();
        std::error_code ignored;
        if (opened_) fs::remove_all(partial_, ignored);
        if (made_folder_) fs::remove(folder_, ignored);  // only if it is empty
        if (lock_ >= 0) ::close(lock_);
    }

    absl::Status open() {
        std::error_code error;
        made_folder_ = fs::create_directories(folder_, error);
        if (error) return cannot_write(folder_, error.message());
        if (absl::Status alone = lock(); !alone.ok()) return alone;
        opened_ = true;
        fs::remove_all(partial_, error);
        fs::create_directories(partial_, error);
        if (error) return cannot_write(partial_, error.message());
        if (absl::Status begun = begin_version(); !begun.ok()) return begun;
        if (options_.save_silhouettes || options_.save_volumes || options_.save_hulls)
            for (int n = 0; n < std::max(options_.threads, 1); ++n)
                threads_.emplace_back([this] { write_waiting(); });
        return absl::OkStatus();
    }

    absl::Status begin_version() override {
        Version version{partial_ / fmt::to_string(versions_.size()), ResultTables(names_), {}};
        std::error_code error;
        fs::create_directories(version.folder, error);
        if (options_.save_silhouettes)
            for (const std::string& name : names_)
                fs::create_directories(version.folder / "silhouettes" / name, error);
        if (options_.save_volumes) fs::create_directories(version.folder / "volumes", error);
        if (options_.save_hulls) fs::create_directories(version.folder / "hulls", error);
        if (error) return cannot_write(version.folder, error.message());
        versions_.push_back(std::move(version));
        return absl::OkStatus();
    }

    absl::Status add(FrameResultPtr result) override {
        versions_.back().tables.add(*result);
        std::unique_lock lock(mutex_);
        if (threads_.empty()) return status_;
        changed_.wait(lock, [this] { return static_cast<int>(waiting_.size()) < options_.max_waiting; });
        waiting_.emplace_back(versions_.back().folder, std::move(result));
        changed_.notify_all();
        return status_;
    }

    void add_table(Table table) override { versions_.back().more_tables.push_back(std::move(table)); }

    absl::Status finish(int version) override;

  private:
    struct Version {
        fs::path folder;
        ResultTables tables;
        std::vector<Table> more_tables;
    };

    // The kernel releases it when this process ends for any reason.
    absl::Status lock() {
        lock_ = ::open(folder_.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC);
        if (lock_ < 0) return cannot_write(folder_, std::generic_category().message(errno));
        if (flock(lock_, LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK)
            return absl::OkStatus();  // some file systems have no locks
        return absl::FailedPreconditionError(fmt::format(
            "{}: another kinevox process is writing there; wait for it or change --out", folder_.string()));
    }

    void write_waiting();
    void end_threads();
    absl::Status write_one(const fs::path& folder, const FrameResult& result) const;

    fs::path folder_, partial_;
    std::vector<std::string> names_;
    ResultWriterOptions options_;
    std::vector<Version> versions_;
    bool made_folder_ = false;
    bool opened_ = false;  // else the partial results belong to another process
    int lock_ = -1;

    std::mutex mutex_;  // guards the members below, but threads_
    std::condition_variable changed_;
    std::deque<std::pair<fs::path, FrameResultPtr>> waiting_;  // with the version's folder
    bool no_more_ = false;
    absl::Status status_;
    std::vector<std::thread> threads_;
};

absl::Status FolderWriter::write_one(const fs::path& folder, const FrameResult& result) const {
    if (options_.save_silhouettes)
        for (std::size_t c = 0; c < names_.size(); ++c) {
            const kernels::Silhouettes& s = result.silhouettes[c];
            if (s.sharp.empty()) continue;  // the camera delivered no image
            const cv::Mat image = as_mat(s.sharp.data(), s.width, s.height);
            const fs::path file = folder / "silhouettes" / names_[c] / six_digits(result.sequence, ".png");
            std::vector<std::uint8_t> png;
            if (!cv::imencode(".png", image, png,
                              {cv::IMWRITE_PNG_COMPRESSION, 1, cv::IMWRITE_PNG_BILEVEL, 1}))
                return cannot_write(file, "PNG encoding failed");
            const std::string_view bytes(reinterpret_cast<const char*>(png.data()), png.size());
            if (absl::Status written = write_file_atomically(file, bytes); !written.ok()) return written;
        }
    // A file per subject: FRAME.ply of the first, FRAME_sID.ply of others.
    for (const SubjectResult& subject : result.subjects) {
        const std::string file_name = six_digits(
            result.sequence,
            &subject == result.first_subject() ? ".ply" : fmt::format("_s{}.ply", subject.track.subject_id));
        absl::Status written;
        if (options_.save_volumes && subject.volume)
            written.Update(write_volume_ply(*subject.volume, folder / "volumes" / file_name));
        if (options_.save_hulls && subject.hull)
            written.Update(write_volume_ply(*subject.hull, folder / "hulls" / file_name));
        if (!written.ok()) return written;
    }
    return absl::OkStatus();
}

void FolderWriter::write_waiting() {
    lower_this_threads_priority();
    std::unique_lock lock(mutex_);
    for (;;) {
        changed_.wait(lock, [this] { return no_more_ || !waiting_.empty(); });
        if (waiting_.empty()) return;
        const auto [folder, result] = std::move(waiting_.front());
        waiting_.pop_front();
        changed_.notify_all();
        if (!status_.ok()) continue;  // drain
        lock.unlock();
        absl::Status written = write_one(folder, *result);
        lock.lock();
        if (!written.ok() && status_.ok()) status_ = std::move(written);
    }
}

void FolderWriter::end_threads() {
    {
        const std::lock_guard lock(mutex_);
        no_more_ = true;
        changed_.notify_all();
    }
    for (std::thread& thread : threads_)
        if (thread.joinable()) thread.join();
}

absl::Status FolderWriter::finish(int version) {
    end_threads();
    if (!status_.ok()) return status_;
    const Version& kept = versions_.at(static_cast<std::size_t>(version));
    std::vector<std::string> made;
    if (options_.save_silhouettes) made.emplace_back("silhouettes");
    if (options_.save_volumes) made.emplace_back("volumes");
    if (options_.save_hulls) made.emplace_back("hulls");
    std::vector<Table> tables = kept.tables.tables();
    tables.insert(tables.end(), kept.more_tables.begin(), kept.more_tables.end());
    for (const Table& table : tables) {
        made.emplace_back(table.file_name);
        if (absl::Status written = write_file_atomically(kept.folder / table.file_name, table.text);
            !written.ok())
            return written;
    }
    // Results of an earlier run go even if this run has none of their kind; its run.toml first, since what is
    // half replaced is not complete.
    std::error_code error;
    std::vector<fs::path> old{folder_ / "run.toml", folder_ / kSubjectNamesFile};
    for (const char* name : {"silhouettes", "volumes", "hulls", "joints.csv", "angles.csv", "coordinates.csv",
                             "uncertainty.csv", "withheld.csv", "body.toml"})
        old.push_back(folder_ / name);
    for (const auto& entry : fs::directory_iterator(folder_, error))
        if (const std::string name = entry.path().filename().string();
            name.starts_with("body_") && name.ends_with(".toml"))
            old.push_back(entry.path());
    for (const fs::path& each : old) {
        fs::remove_all(each, error);
        if (error) return cannot_write(each, error.message());
    }
    for (const std::string& name : made) {
        fs::rename(kept.folder / name, folder_ / name, error);
        if (error) return cannot_write(folder_ / name, error.message());
    }
    fs::remove_all(partial_, error);
    return absl::OkStatus();
}

}  // namespace

ResultTables::ResultTables(const std::vector<std::string>& camera_names)
    : camera_count_(camera_names.size()) {
    tables_ = {
        {"volume.csv", "frame,subject,voxel_mm,voxels,volume_litres,min_x,min_y,min_z,max_x,max_y,max_z\n"},
        {"timing.csv", "frame,segmentation_ms,tracking_ms,hull_ms,colouring_ms,pose_ms,total_ms\n"},
        {"track.csv",
         "frame,time_s,subject,centre_x_m,centre_y_m,centre_z_m,centre_std_m,used_camera_count\n"},
        {"silhouette_iou.csv", "frame,subject"},
        {"events.csv", "frame,time_s,subject,kind,camera,message\n"}};
    for (const std::string& name : camera_names)
        tables_[kSilhouetteIou].text.append(1, ',').append(csv_cell(name));
    tables_[kSilhouetteIou].text += '\n';
}

void ResultTables::add_subject(std::uint64_t frame, double time_s, const SubjectResult& result) {
    const SubjectTrack& s = result.track;
    const std::string subject = subject_cell(s.subject_id);
    std::string& volume = tables_[kVolume].text;
    const auto extent = result.volume ? extent_of(*result.volume) : std::nullopt;
    if (result.volume)
        append(volume, "{},{},{:g},{},{:.3f}", frame, subject, 1000 * result.volume->grid.voxel_m,
               voxel_count(*result.volume), volume_litres(*result.volume));
    else
        append(volume, "{},{},,,", frame, subject);
    if (extent) {
        const Vec3 a = extent->min_in_world, b = extent->max_in_world;
        append(volume, ",{:.4f},{:.4f},{:.4f},{:.4f},{:.4f},{:.4f}\n", a.x, a.y, a.z, b.x, b.y, b.z);
    } else {
        volume += ",,,,,,\n";
    }
    append(tables_[kTrack].text, "{},{:.6f},{},{:.4f},{:.4f},{:.4f},{:.4f},{}\n", frame, time_s, subject,
           s.centre_in_world.x, s.centre_in_world.y, s.centre_in_world.z, s.centre_std_m,
           std::count(s.used_cameras.begin(), s.used_cameras.end(), true));
    std::string& iou = tables_[kSilhouetteIou].text;
    append(iou, "{},{}", frame, subject);
    for (const float value : result.silhouette_iou) {
        if (std::isnan(value))
            iou += ',';
        else
            append(iou, ",{:.4f}", value);
    }
    iou += '\n';
}

void ResultTables::add(const FrameResult& result) {
    const auto frame = result.sequence;
    const double time_s = 1e-9 * static_cast<double>(result.capture_time_ns);

    if (result.subjects.empty()) {
        append(tables_[kVolume].text, "{},,,,,,,,,,\n", frame);
        append(tables_[kTrack].text, "{},{:.6f},,,,,,\n", frame, time_s);
        append(tables_[kSilhouetteIou].text, "{},{}\n", frame, std::string(camera_count_, ','));
    }
    for (const SubjectResult& subject : result.subjects) add_subject(frame, time_s, subject);

    const StageTimes& t = result.times;
    append(tables_[kTiming].text, "{},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f}\n", frame, t.segmentation_ms,
           t.tracking_ms, t.hull_ms, t.colouring_ms, t.pose_ms, t.total_ms);

    for (const Event& event : result.events)
        append(tables_[kEvents].text, "{},{:.6f},{},{},{},{}\n", event.sequence,
               1e-9 * static_cast<double>(event.time_ns), subject_cell(event.subject_id),
               event_name(event.kind), csv_cell(event.camera), csv_cell(event.message));
}

absl::StatusOr<std::unique_ptr<ResultWriter>> ResultWriter::create(const fs::path& folder,
                                                                   std::vector<std::string> camera_names,
                                                                   const ResultWriterOptions& options) {
    auto writer = std::make_unique<FolderWriter>(folder, std::move(camera_names), options);
    if (absl::Status opened = writer->open(); !opened.ok()) return opened;
    return writer;
}

}  // namespace kinevox
