#include "server/recording/recording_folder.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <condition_variable>
#include <map>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include "common/calibration_file.h"
#include "common/files.h"
#include "common/recording_files.h"
#include "server/recording/csv_tables.h"
#include "server/recording/growing_files.h"
#include "server/recording/subject_names.h"
#include "server/recording/volume_file.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kReserveBytes = 4 << 20;  // reserved for what closing writes
constexpr std::chrono::seconds kSyncInterval{1};

absl::Status unavailable(const fs::path& path, const std::error_code& error) {
    return absl::UnavailableError(
        fmt::format("{}: {}; correct [recording] folder or its permissions", path.string(), error.message()));
}

// A hard link if the file system supports it, else a copy.
absl::Status link_or_copy(const fs::path& from, const fs::path& to) {
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
    absl::Status append_rows(PoseRow row, const std::vector<RecordedSubject>& subjects);
    absl::Status append_volumes(std::uint64_t frame, const std::vector<RecordedSubject>& subjects);
    absl::Status write_body_of(const RecordedSubject& subject);
    absl::Status write_names(const std::vector<RecordedSubject>& subjects);
    std::uint64_t growing_bytes() const;  // of the files below
    void measure_other_files();
    template <typename Use>
    void for_files(const Use& use) const;

    const RecordingPlan plan_;
    const fs::path folder_;
    Session session_;
    std::vector<std::unique_ptr<VideoFile>> videos_;
    AppendFile times_, reserve_;
    std::vector<AppendFile> tables_;  // as kPoseTableNames
    std::unique_ptr<VolumeFile> volumes_;
    std::map<std::uint32_t, std::shared_ptr<const BodyShape>> bodies_;  // by subject, as written
    SubjectNames names_;                                                // as written
    std::vector<std::int64_t> row_times_ns_;                            // of the frames that have no row yet
    std::uint64_t first_row_ = 0;                                       // the first of them
    std::int64_t first_capture_ns_ = 0, last_time_ns_ = 0;
    std::uint64_t last_sequence_ = 0;
    std::uint64_t other_bytes_ = 0;  // of the files that do not grow
    std::jthread syncing_;
};

absl::Status SessionFolder::make_folder() {
    std::error_code error;
    fs::create_directories(folder_.parent_path(), error);
    if (error) return unavailable(folder_.parent_path(), error);
    if (!fs::create_directory(folder_, error)) {
        if (error) return unavailable(folder_, error);
        return absl::AlreadyExistsError(
            fmt::format("recording \"{}\" exists; choose another name", folder_.filename().string()));
    }
    auto reserve = AppendFile::create(folder_ / ".reserve");
    if (!reserve.ok()) return reserve.status();
    reserve_ = *std::move(reserve);
    return reserve_.append(std::string(kReserveBytes, '\0'));
}

absl::Status SessionFolder::write_calibration() {
    session_.calibration = folder_ / "calibration.toml";
    // The original file if it holds the same cameras: rewriting a rotation may change its last bit.
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
    times_.lock();  // a recording that is being written is not repaired
    if (plan_.save_poses) {
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
    if (plan_.save_volumes) {
        auto volumes = VolumeFile::create(folder_ / "volumes.kvxv", plan_.several_subjects
                                                                        ? VolumeFile::Version::kWithSubjects
                                                                        : VolumeFile::Version::kFirst);
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
        if (absl::Status taken = link_or_copy(videos[c], background); !taken.ok()) return taken;
        if (absl::Status taken = link_or_copy(video_index_file(videos[c]), video_index_file(background));
            !taken.ok())
            return taken;
        session_.cameras[c].background = background;
    }
    return absl::OkStatus();
}

absl::Status SessionFolder::set_background(const std::vector<fs::path>& videos) {
    if (videos.empty() || !session_.cameras.front().background.empty()) return absl::OkStatus();
    if (absl::Status taken = take_background(videos); !taken.ok()) return taken;
    const absl::Status written = write_session(session_, folder_ / "session.toml");
    measure_other_files();
    return written;
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
    recording.frame_times = folder_ / "frames.csv";
    if (plan_.save_poses) recording.poses = folder_ / "poses";
    if (plan_.save_volumes) recording.volumes = folder_ / "volumes.kvxv";
    recording.codec = name_of(plan_.codec);
    recording.calibration_id = plan_.calibration_id;
    recording.closed = false;
    if (absl::Status written = write_session(session_, folder_ / "session.toml"); !written.ok())
        return written;
    measure_other_files();
    // After a power failure, all but about the last second is on the disk.
    syncing_ = std::jthread([this](const std::stop_token& stop) {
        std::mutex mutex;
        std::condition_variable_any never;
        for (;;) {
            std::unique_lock lock(mutex);
            never.wait_for(lock, stop, kSyncInterval, [] { return false; });
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
    const bool first = recording.frame_sets == 0;
    if (first) {
        first_capture_ns_ = set.capture_time_ns;
        recording.start_time_utc_ns = set.capture_time_utc_ns;
    }
    const RecordedTime time{set.sequence, set.capture_time_ns - first_capture_ns_, set.capture_time_utc_ns};
    absl::Status written;
    std::size_t done = 0;
    for (; done < videos_.size() && written.ok(); ++done)
        written = videos_[done]->append(*set.images[done], time.time_ns);
    if (written.ok()) written = times_.append(recorded_time_line(recording.frame_sets, time));
    if (!written.ok()) {  // all videos end with the same set
        for (std::size_t c = 0; c < done; ++c)
            if (videos_[c]->frames() > recording.frame_sets) videos_[c]->take_back().IgnoreError();
        return written;
    }
    if (!first) recording.lost_frame_sets += set.sequence - last_sequence_ - 1;
    for (const auto& image : set.images) recording.missing_images += image->missing ? 1 : 0;
    last_sequence_ = set.sequence;
    last_time_ns_ = time.time_ns;
    row_times_ns_.push_back(time.time_ns);
    ++recording.frame_sets;
    return absl::OkStatus();
}

absl::Status SessionFolder::append_row(const PoseRow& row) {
    const auto lines = pose_table_rows(row);
    for (std::size_t t = 0; t < tables_.size(); ++t)
        if (absl::Status written = tables_[t].append(lines[t]); !written.ok()) return written;
    return absl::OkStatus();
}

// One for each subject; one without a subject for a frame without any.
absl::Status SessionFolder::append_rows(PoseRow row, const std::vector<RecordedSubject>& subjects) {
    if (subjects.empty()) return append_row(row);
    for (const RecordedSubject& subject : subjects) {
        row.subject_id = subject.id;
        row.pose = subject.pose;
        if (absl::Status written = append_row(row); !written.ok()) return written;
        if (absl::Status written = write_body_of(subject); !written.ok()) return written;
    }
    return absl::OkStatus();
}

absl::Status SessionFolder::append_volumes(std::uint64_t frame,
                                           const std::vector<RecordedSubject>& subjects) {
    for (const RecordedSubject& subject : subjects) {
        if (subject.volume.empty() && !plan_.several_subjects) continue;
        if (absl::Status written = volumes_->append(frame, subject.id, subject.volume); !written.ok())
            return written;
    }
    return absl::OkStatus();
}

// body_ID.toml, as `kinevox process` writes it: of each subject with a pose.
absl::Status SessionFolder::write_body_of(const RecordedSubject& subject) {
    if (!plan_.save_poses || !subject.body || !subject.pose) return absl::OkStatus();
    std::shared_ptr<const BodyShape>& known = bodies_[subject.id];
    if (known && *known == *subject.body) return absl::OkStatus();
    known = subject.body;
    const absl::Status written =
        write_body_shape(*known, folder_ / "poses" / fmt::format("body_{}.toml", subject.id));
    measure_other_files();
    return written;
}

// subjects.csv, with the latest names. Without a name there is no such file.
absl::Status SessionFolder::write_names(const std::vector<RecordedSubject>& subjects) {
    if (!plan_.save_poses) return absl::OkStatus();
    SubjectNames names = names_;
    for (const RecordedSubject& subject : subjects) set_subject_name(names, subject.id, subject.name);
    if (names == names_) return absl::OkStatus();
    names_ = std::move(names);
    const absl::Status written =
        write_file_atomically(folder_ / "poses" / kSubjectNamesFile, subject_names_csv(names_));
    measure_other_files();
    return written;
}

absl::Status SessionFolder::append_result(std::uint64_t frame, const RecordedResult& result) {
    if (frame < first_row_ || frame >= session_.recording->frame_sets) return absl::OkStatus();
    const auto index = static_cast<std::size_t>(frame - first_row_);
    absl::Status written;
    for (std::size_t i = 0; i <= index && written.ok(); ++i) {
        const PoseRow row{.frame = first_row_ + i, .time_s = 1e-9 * static_cast<double>(row_times_ns_[i])};
        written = i == index ? append_rows(row, result.subjects) : append_row(row);
    }
    if (written.ok()) written = write_names(result.subjects);
    if (written.ok() && volumes_) written = append_volumes(frame, result.subjects);
    row_times_ns_.erase(row_times_ns_.begin(),
                        row_times_ns_.begin() + static_cast<std::ptrdiff_t>(index) + 1);
    first_row_ = frame + 1;
    return written;
}

absl::Status SessionFolder::set_body(const BodyShape& body) {
    if (!plan_.save_poses) return absl::OkStatus();
    const absl::Status written = write_body_shape(body, folder_ / "poses" / "body.toml");
    measure_other_files();
    return written;
}

absl::Status SessionFolder::close(const Ending& ending) {
    syncing_ = {};
    SessionRecording& recording = *session_.recording;
    absl::Status closed = reserve_.truncate(0);
    std::error_code ignored;
    fs::remove(reserve_.path(), ignored);
    if (recording.frame_sets > first_row_) closed.Update(append_result(recording.frame_sets - 1, {}));
    for (const auto& video : videos_) video->close().IgnoreError();  // can be read without
    for_files([](const auto& file) { file.sync(); });
    recording.dropped_frame_sets = ending.dropped;
    recording.lost_frame_sets -=
        std::min(recording.lost_frame_sets, ending.dropped);  // both are gaps in the sequence
    recording.end_reason = ending.reason;
    recording.closed = true;
    closed.Update(write_session(session_, folder_ / "session.toml"));
    times_ = {};  // releases the lock
    measure_other_files();
    return closed;
}

std::uint64_t SessionFolder::growing_bytes() const {
    std::uint64_t bytes = times_.size() + (volumes_ ? volumes_->bytes() : 0);
    for (const auto& video : videos_) bytes += video->bytes();
    for (const AppendFile& table : tables_) bytes += table.size();
    return bytes;
}

void SessionFolder::measure_other_files() {
    const std::uint64_t all = recording_size_bytes(folder_), growing = growing_bytes();
    other_bytes_ = all - std::min(all, growing);
}

RecordingInfo SessionFolder::info() const {
    const std::uint64_t bytes = growing_bytes() + other_bytes_;
    const bool any = session_.recording->frame_sets > 0;
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
