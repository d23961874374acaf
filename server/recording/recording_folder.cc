#include "server/recording/recording_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <condition_variable>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include "common/atomic_file.h"
#include "common/calibration_file.h"
#include "common/recording_files.h"
#include "server/recording/append_file.h"
#include "server/recording/pose_tables.h"
#include "server/recording/video_file.h"
#include "server/recording/volume_file.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kReserveBytes = 4 << 20;  // kept free for what closing writes
constexpr std::chrono::seconds kSyncEvery{1};

absl::Status unavailable(const fs::path& path, const std::error_code& error) {
    return absl::UnavailableError(
        fmt::format("{}: {}; correct [recording] folder or its rights", path.string(), error.message()));
}

// The same file under another name where the disk allows it, else a copy.
absl::Status take_over(const fs::path& from, const fs::path& to) {
    std::error_code error;
    fs::create_hard_link(from, to, error);
    if (error) fs::copy_file(from, to, error);
    return error ? unavailable(to, error) : absl::OkStatus();
}

class SessionFolder final : public RecordingFolder {
  public:
    explicit SessionFolder(RecordingPlan plan) : plan_(std::move(plan)), folder_(plan_.folder) {}
    ~SessionFolder() override { syncing_ = {}; }

    absl::Status open();
    absl::Status append(const EncodedSet& set) override;
    absl::Status append_result(std::uint64_t frame, const RecordedResult& result) override;
    absl::Status set_background(const std::vector<fs::path>& videos) override;
    absl::Status set_body(const BodyShape& body) override;
    absl::Status close(const Ending& ending) override;
    const SessionRecording& about() const override { return *session_.recording; }
    const fs::path& path() const override { return folder_; }
    RecordingInfo info() const override;

  private:
    absl::Status make_folder();
    absl::Status write_calibration();
    absl::Status take_background(const std::vector<fs::path>& videos);
    absl::Status open_tables();
    absl::Status append_row(const PoseRow& row);
    template <typename Use>
    void for_files(const Use& use) const;

    const RecordingPlan plan_;
    const fs::path folder_;
    Session session_;
    std::vector<std::unique_ptr<VideoFile>> videos_;
    AppendFile times_, reserve_;
    std::vector<AppendFile> tables_;  // as kPoseTableNames
    std::unique_ptr<VolumeFile> volumes_;
    std::vector<std::int64_t> row_times_ns_;  // of the frames that have no row yet
    std::uint64_t first_row_ = 0;             // the frame of the first of them
    std::int64_t first_capture_ns_ = 0, last_time_ns_ = 0;
    std::uint64_t last_sequence_ = 0;
    std::jthread syncing_;
};

absl::Status SessionFolder::make_folder() {
    std::error_code error;
    fs::create_directories(folder_.parent_path(), error);
    if (error) return unavailable(folder_.parent_path(), error);
    if (!fs::create_directory(folder_, error)) {
        if (error) return unavailable(folder_, error);
        return absl::AlreadyExistsError(fmt::format(
            "there is a recording \"{}\" already; choose another name", folder_.filename().string()));
    }
    auto reserve = AppendFile::create(folder_ / ".reserve");
    if (!reserve.ok()) return reserve.status();
    reserve_ = *std::move(reserve);
    return reserve_.append(std::string(kReserveBytes, '\0'));
}

absl::Status SessionFolder::write_calibration() {
    session_.calibration = folder_ / "calibration.toml";
    // The file itself where it says the very same: writing a rotation anew may move its last bit.
    const auto holds = [&](const std::vector<Camera>& cameras) {
        return std::ranges::all_of(plan_.cameras, [&](const Camera& camera) {
            const Camera* const found = camera_named(cameras, camera.name);
            return found && *found == camera;
        });
    };
    const auto text = read_file(plan_.calibration_file);
    const auto same =
        text.ok() ? parse_calibration_toml(*text, plan_.calibration_file.string()) : text.status();
    const absl::Status written = same.ok() && holds(*same)
                                     ? write_file_atomically(session_.calibration, *text)
                                     : write_calibration_toml(plan_.cameras, session_.calibration);
    if (!written.ok()) return written;
    if (plan_.certificate_json.empty()) return absl::OkStatus();
    return write_file_atomically(folder_ / "calibration.certificate.json", plan_.certificate_json);
}

absl::Status SessionFolder::open_tables() {
    const auto begin = [&](AppendFile& table, const fs::path& file, std::string_view header) {
        auto made = AppendFile::create(file);
        if (!made.ok()) return made.status();
        table = *std::move(made);
        return table.append(header);
    };
    if (absl::Status begun = begin(times_, folder_ / "frames.csv", kRecordedTimesHeader); !begun.ok())
        return begun;
    times_.lock();  // nobody repairs a recording that is being written
    if (plan_.poses) {
        std::error_code error;
        fs::create_directory(folder_ / "poses", error);
        if (error) return unavailable(folder_ / "poses", error);
        const auto headers = pose_table_headers();
        tables_.resize(headers.size());
        for (std::size_t t = 0; t < headers.size(); ++t)
            if (absl::Status begun = begin(tables_[t], folder_ / "poses" / kPoseTableNames[t], headers[t]);
                !begun.ok())
                return begun;
        if (plan_.body)
            if (absl::Status written = set_body(*plan_.body); !written.ok()) return written;
    }
    if (plan_.volumes) {
        auto volumes = VolumeFile::create(folder_ / "volumes.kvxv");
        if (!volumes.ok()) return volumes.status();
        volumes_ = *std::move(volumes);
    }
    return absl::OkStatus();
}

absl::Status SessionFolder::take_background(const std::vector<fs::path>& videos) {
    if (videos.size() != session_.cameras.size()) return absl::OkStatus();
    std::error_code error;
    fs::create_directory(folder_ / "background", error);
    for (std::size_t c = 0; c < videos.size(); ++c) {
        const fs::path background = folder_ / "background" / (session_.cameras[c].name + ".mkv");
        if (absl::Status taken = take_over(videos[c], background); !taken.ok()) return taken;
        if (absl::Status taken = take_over(video_index_file(videos[c]), video_index_file(background));
            !taken.ok())
            return taken;
        session_.cameras[c].background = background;
    }
    return absl::OkStatus();
}

absl::Status SessionFolder::set_background(const std::vector<fs::path>& videos) {
    if (videos.empty() || !session_.cameras.front().background.empty()) return absl::OkStatus();
    if (absl::Status taken = take_background(videos); !taken.ok()) return taken;
    return write_session(session_, folder_ / "session.toml");
}

absl::Status SessionFolder::open() {
    if (absl::Status made = make_folder(); !made.ok()) return made;
    if (absl::Status written = write_calibration(); !written.ok()) return written;
    session_.name = folder_.filename().string();
    session_.fps = plan_.fps;
    for (std::size_t c = 0; c < plan_.cameras.size(); ++c) {
        SessionCamera camera{plan_.cameras[c].name, folder_ / (plan_.cameras[c].name + ".mkv"), {}};
        auto video = VideoFile::create(camera.video, plan_.formats[c]);
        if (!video.ok()) return video.status();
        videos_.push_back(*std::move(video));
        session_.cameras.push_back(std::move(camera));
    }
    if (absl::Status taken = take_background(plan_.background); !taken.ok()) return taken;
    if (absl::Status begun = open_tables(); !begun.ok()) return begun;
    SessionRecording& recording = session_.recording.emplace();
    recording.times = folder_ / "frames.csv";
    if (plan_.poses) recording.poses = folder_ / "poses";
    if (plan_.volumes) recording.volumes = folder_ / "volumes.kvxv";
    recording.codec = name_of(plan_.codec);
    recording.calibration_id = plan_.calibration_id;
    recording.closed = false;
    if (absl::Status written = write_session(session_, folder_ / "session.toml"); !written.ok())
        return written;
    // Power may fail, too: what is older than about a second is on the disk then.
    syncing_ = std::jthread([this](const std::stop_token& stop) {
        std::mutex mutex;
        std::condition_variable_any never;
        for (;;) {
            std::unique_lock lock(mutex);
            never.wait_for(lock, stop, kSyncEvery, [] { return false; });
            if (stop.stop_requested()) return;
            for_files([](const auto& file) { file.sync(); });
        }
    });
    return absl::OkStatus();
}

template <typename Use>
void SessionFolder::for_files(const Use& use) const {
    for (const auto& video : videos_) use(*video);
    use(times_);
    for (const AppendFile& table : tables_) use(table);
    if (volumes_) use(*volumes_);
}

absl::Status SessionFolder::append(const EncodedSet& set) {
    SessionRecording& recording = *session_.recording;
    const bool first = recording.frames == 0;
    if (first) {
        first_capture_ns_ = set.capture_time_ns;
        recording.started_utc_ns = set.capture_time_utc_ns;
    }
    const RecordedTime time{set.sequence, set.capture_time_ns - first_capture_ns_, set.capture_time_utc_ns};
    absl::Status written;
    std::size_t done = 0;
    for (; done < videos_.size() && written.ok(); ++done)
        written = videos_[done]->append(*set.pictures[done], time.time_ns);
    if (written.ok()) written = times_.append(recorded_time_line(recording.frames, time));
    if (!written.ok()) {  // all videos end with the same set
        for (std::size_t c = 0; c < done; ++c)
            if (videos_[c]->frames() > recording.frames) videos_[c]->take_back().IgnoreError();
        return written;
    }
    if (!first) recording.lost += set.sequence - last_sequence_ - 1;
    for (const auto& picture : set.pictures) recording.missing_pictures += picture->missing ? 1 : 0;
    last_sequence_ = set.sequence;
    last_time_ns_ = time.time_ns;
    row_times_ns_.push_back(time.time_ns);
    ++recording.frames;
    return absl::OkStatus();
}

absl::Status SessionFolder::append_row(const PoseRow& row) {
    const auto lines = pose_table_rows(row);
    for (std::size_t t = 0; t < tables_.size(); ++t)
        if (absl::Status written = tables_[t].append(lines[t]); !written.ok()) return written;
    return absl::OkStatus();
}

absl::Status SessionFolder::append_result(std::uint64_t frame, const RecordedResult& result) {
    if (frame < first_row_ || frame >= session_.recording->frames) return absl::OkStatus();
    const auto index = static_cast<std::size_t>(frame - first_row_);
    absl::Status written;
    for (std::size_t i = 0; i <= index && written.ok(); ++i)
        written = append_row({first_row_ + i, 1e-9 * static_cast<double>(row_times_ns_[i]),
                              i == index ? result.pose : nullptr});
    if (written.ok() && volumes_ && !result.volume.empty()) written = volumes_->append(frame, result.volume);
    row_times_ns_.erase(row_times_ns_.begin(),
                        row_times_ns_.begin() + static_cast<std::ptrdiff_t>(index) + 1);
    first_row_ = frame + 1;
    return written;
}

absl::Status SessionFolder::set_body(const BodyShape& body) {
    if (!plan_.poses) return absl::OkStatus();
    return write_body_shape(body, folder_ / "poses" / "body.toml");
}

absl::Status SessionFolder::close(const Ending& ending) {
    syncing_ = {};
    SessionRecording& recording = *session_.recording;
    absl::Status closed = reserve_.truncate(0);
    std::error_code ignored;
    fs::remove(reserve_.path(), ignored);
    if (recording.frames > first_row_) closed.Update(append_result(recording.frames - 1, {}));
    for (const auto& video : videos_) video->close().IgnoreError();  // can be read without
    for_files([](const auto& file) { file.sync(); });
    recording.dropped = ending.dropped;
    recording.lost -= std::min(recording.lost, ending.dropped);  // both are gaps in the sequence
    recording.end_reason = ending.reason;
    recording.closed = true;
    closed.Update(write_session(session_, folder_ / "session.toml"));
    times_ = {};  // lets go of the lock
    return closed;
}

RecordingInfo SessionFolder::info() const {
    std::uint64_t bytes = times_.size() + (volumes_ ? volumes_->bytes() : 0);
    for (const auto& video : videos_) bytes += video->bytes();
    for (const AppendFile& table : tables_) bytes += table.size();
    const bool any = session_.recording->frames > 0;
    return recording_info(session_, folder_ / "session.toml",
                          any ? std::optional(last_time_ns_) : std::nullopt, bytes);
}

}  // namespace

absl::StatusOr<std::unique_ptr<RecordingFolder>> RecordingFolder::create(const RecordingPlan& plan) {
    auto folder = std::make_unique<SessionFolder>(plan);
    if (absl::Status opened = folder->open(); !opened.ok()) {
        std::error_code ignored;
        if (!absl::IsAlreadyExists(opened)) fs::remove_all(plan.folder, ignored);
        return opened;
    }
    return folder;
}

}  // namespace kinevox
