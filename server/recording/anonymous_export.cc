#include "server/recording/anonymous_export.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <oneapi/tbb/task_arena.h>
#include <stdlib.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <system_error>
#include <utility>

#include "common/calibration_file.h"
#include "common/files.h"
#include "common/recording_files.h"
#include "common/session_file.h"
#include "common/volume_codec.h"
#include "server/cameras/session_files.h"
#include "server/cameras/session_source.h"
#include "server/pipeline/pipeline.h"
#include "server/recording/background_clip.h"
#include "server/recording/growing_files.h"
#include "server/recording/image_encoder.h"
#include "server/recording/recording_export.h"
#include "server/recording/subjects_of_result.h"
#include "server/recording/volume_file.h"
#include "server/silhouettes/silhouettes.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

absl::Status run_pipeline(const Session& session, std::int64_t frame_sets, int max_subjects,
                          const std::function<absl::Status(const FrameResult&)>& take,
                          const JobControl& work) {
    const auto source = open_session_source(session);
    if (!source.ok()) return source.status();
    const auto background = background_of_all(**source, session.name);
    if (!background.ok())
        return absl::FailedPreconditionError(
            fmt::format("silhouettes require a background: {}", std::string(background.status().message())));
    PipelineOptions options;  // with colours: the volume of a frame is the prior of the next
    options.pose = false;
    options.tracker.max_subjects = max_subjects;
    const auto pipeline = Pipeline::create((*source)->cameras(), (*source)->fps(), options);
    if (!pipeline.ok()) return pipeline.status();
    if (absl::Status learned = (*pipeline)->learn_background(*background); !learned.ok()) return learned;
    for (std::int64_t n = 0; n < frame_sets; ++n) {
        if (work.stop) return absl::CancelledError("the export was stopped");
        auto frame_set = (*source)->next();
        if (absl::IsOutOfRange(frame_set.status()))
            return absl::DataLossError(
                fmt::format("session \"{}\" has {} frame sets, but poses of {}; rerun `kinevox process`",
                            session.name, n, frame_sets));
        if (!frame_set.ok()) return frame_set.status();
        const auto result = (*pipeline)->process(*std::move(frame_set));
        if (!result.ok()) return result.status();
        if (absl::Status taken = take(**result); !taken.ok()) return taken;
        work.report(static_cast<double>(n + 1) / static_cast<double>(frame_sets));
    }
    return absl::OkStatus();
}

struct SilhouettePassOptions {
    std::int64_t frame_sets = 0;  // from the first
    int max_subjects = 1;
    bool one_thread = false;  // besides the decoders': next to a running capture
};

// Passes each frame set's result to `take`, in order, without poses; stops at its first error.
// FailedPrecondition if a camera has no background; Cancelled after `work.stop`; errors of reading.
absl::Status find_silhouettes(const Session& session, const SilhouettePassOptions& options,
                              const std::function<absl::Status(const FrameResult&)>& take,
                              const JobControl& work) {
    if (!options.one_thread)
        return run_pipeline(session, options.frame_sets, options.max_subjects, take, work);
    oneapi::tbb::task_arena arena(1);
    return arena.execute(
        [&] { return run_pipeline(session, options.frame_sets, options.max_subjects, take, work); });
}

Image grey_image(int width, int height, std::span<const std::uint8_t> values) {
    std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[static_cast<std::size_t>(width) * height]());
    std::copy(values.begin(), values.end(), data.get());
    return {width, height, 1, std::move(data)};
}

// Relative to the first one: nothing may reveal the date.
absl::StatusOr<std::vector<RecordedTime>> times_of(const Session& session, std::size_t frame_sets) {
    std::vector<RecordedTime> times;
    if (session.recording) {
        auto recorded = complete_frame_sets(session);
        if (!recorded.ok()) return recorded.status();
        times = *std::move(recorded);
    } else {
        for (std::size_t n = 0; n < frame_sets; ++n)
            times.push_back({n, std::llround(1e9 * static_cast<double>(n) / session.fps), 0});
    }
    times.resize(std::min(times.size(), frame_sets));
    for (RecordedTime& time : times) time.capture_time_utc_ns = time.time_ns;
    return times;
}

class AnonymousFolder {
  public:
    AnonymousFolder(const Session& session, const MeasuredTrials& measured, fs::path folder)
        : folder_(std::move(folder)), measured_(measured), matcher_(measured.trials) {
        made_.session.name = kAnonymous;
        made_.session.fps = session.fps;
        made_.session.calibration = file("calibration.toml");
        made_.session.recording.emplace();
    }

    absl::Status open(const Session& session, std::size_t frame_sets);
    absl::Status add(const FrameResult& result);
    absl::Status add_tables();
    absl::StatusOr<AnonymousSession> close(const Session& session);

  private:
    bool several() const { return measured_.max_at_once > 1; }
    fs::path file(const std::string& name) {
        made_.files.push_back(folder_ / name);
        return made_.files.back();
    }
    absl::Status open_videos();
    absl::Status write_backgrounds();

    std::vector<std::uint8_t> silhouette(const kernels::Silhouettes& seen, const Camera& camera) const;

    const fs::path folder_;
    const MeasuredTrials& measured_;
    SubjectMatcher matcher_;
    std::vector<SubjectMatcher::Match> subjects_;  // of the frame set being added
    AnonymousSession made_;
    std::vector<Camera> cameras_;
    std::vector<RecordedTime> times_;
    std::vector<std::unique_ptr<ImageEncoder>> encoders_;
    std::vector<std::unique_ptr<VideoFile>> videos_;
    std::unique_ptr<VolumeFile> volumes_;
    std::size_t added_ = 0;
};

absl::Status AnonymousFolder::open(const Session& session, std::size_t frame_sets) {
    auto cameras = read_session_cameras(session);
    if (!cameras.ok()) return cameras.status();
    cameras_ = *std::move(cameras);
    for (std::size_t c = 0; c < cameras_.size(); ++c) cameras_[c].name = anonymous_camera_name(c);
    auto times = times_of(session, frame_sets);
    if (!times.ok()) return times.status();
    times_ = *std::move(times);
    if (absl::Status opened = open_videos(); !opened.ok()) return opened;
    SessionRecording& recording = *made_.session.recording;
    recording.volumes = file("volumes.kvxv");
    auto volumes = VolumeFile::create(
        recording.volumes, several() ? VolumeFile::Version::kWithSubjects : VolumeFile::Version::kFirst);
    if (!volumes.ok()) return volumes.status();
    volumes_ = *std::move(volumes);
    return write_backgrounds();
}

absl::Status AnonymousFolder::open_videos() {
    for (const Camera& camera : cameras_) {
        auto encoder = ImageEncoder::create(camera, made_.session.fps, VideoCodec::kFfv1);
        if (!encoder.ok()) return encoder.status();
        const fs::path path = file(camera.name + ".mkv");
        file(camera.name + ".index");
        auto video = VideoFile::create(path, (*encoder)->format());
        if (!video.ok()) return video.status();
        encoders_.push_back(*std::move(encoder));
        videos_.push_back(*std::move(video));
        made_.session.cameras.push_back({camera.name, path, {}});
    }
    return absl::OkStatus();
}

// Silhouettes contrast with black, so that the pipeline finds them again.
absl::Status AnonymousFolder::write_backgrounds() {
    std::vector<Camera> cameras = cameras_;
    std::vector<std::vector<Image>> black;
    for (Camera& camera : cameras) {
        camera.name += "_background";
        black.push_back({grey_image(camera.width, camera.height, {})});
    }
    const auto files = write_background_videos(folder_, cameras, made_.session.fps, black, {});
    if (!files.ok()) return files.status();
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        made_.session.cameras[c].background = file(cameras[c].name + ".mkv");
        file(cameras[c].name + ".index");
    }
    return absl::OkStatus();
}

std::vector<std::uint8_t> AnonymousFolder::silhouette(const kernels::Silhouettes& seen,
                                                      const Camera& camera) const {
    return several() ? silhouette_of(subjects_, seen, camera)
                     : main_subject(seen.sharp, seen.width, seen.height);
}

absl::Status AnonymousFolder::add(const FrameResult& result) {
    const std::size_t frame = added_++;
    if (several())
        subjects_ = matcher_.match(result, static_cast<std::int64_t>(frame));
    else if (const SubjectResult* const subject = result.first_subject())
        subjects_ = {{subject->track.subject_id, subject}};
    else
        subjects_.clear();
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        const kernels::Silhouettes& seen = result.silhouettes[c];
        Image image;  // stays empty if the camera delivered no image
        if (!seen.sharp.empty()) image = grey_image(seen.width, seen.height, silhouette(seen, cameras_[c]));
        const auto encoded = encoders_[c]->encode(image, true);
        if (!encoded.ok()) return encoded.status();
        if (absl::Status written = videos_[c]->append(**encoded, times_[frame].time_ns); !written.ok())
            return written;
    }
    for (const SubjectMatcher::Match& subject : subjects_) {
        std::string encoded;
        if (subject.result->volume) {
            Volume volume = *subject.result->volume;
            volume.colours.clear();
            encoded = encode_volume(volume);
        }
        if (encoded.empty() && !several()) continue;
        if (absl::Status written = volumes_->append(frame, subject.id, encoded); !written.ok())
            return written;
    }
    return absl::OkStatus();
}

// The trial's own tables, which contain only numbers; the body is rewritten, since users may add comments.
absl::Status AnonymousFolder::add_tables() {
    const Trial& trial = measured_.trials.front();
    std::error_code error;
    for (const std::string_view name : kPoseTableNames) {
        if (!fs::exists(trial.folder / name, error)) continue;
        const fs::path target = file(std::string(name));
        fs::copy_file(trial.folder / name, target, error);
        if (error)
            return absl::UnavailableError(
                fmt::format("{}: cannot be written: {}", target.string(), error.message()));
        fs::permissions(target, fs::perms::owner_write, fs::perm_options::add, error);
    }
    made_.session.recording->poses = folder_ / ".";
    for (const Trial& each : measured_.trials) {
        if (!each.body || !several()) continue;
        const fs::path own = file(fmt::format("body_{}.toml", each.subject_id));
        if (absl::Status written = write_file_atomically(own, body_shape_toml(*each.body)); !written.ok())
            return written;
    }
    if (!trial.body) return absl::OkStatus();
    return write_file_atomically(file("body.toml"), body_shape_toml(*trial.body));
}

absl::StatusOr<AnonymousSession> AnonymousFolder::close(const Session& session) {
    for (const auto& video : videos_)
        if (absl::Status closed = video->close(); !closed.ok()) return closed;
    volumes_.reset();
    if (absl::Status written = write_calibration_toml(cameras_, made_.session.calibration); !written.ok())
        return written;
    std::string lines(kRecordedTimesHeader);
    for (std::size_t n = 0; n < times_.size(); ++n) lines += recorded_time_line(n, times_[n]);
    SessionRecording& recording = *made_.session.recording;
    recording.frame_times = file("frames.csv");
    if (absl::Status written = write_file_atomically(recording.frame_times, lines); !written.ok())
        return written;
    recording.codec = name_of(VideoCodec::kFfv1);
    recording.closed = true;
    recording.frame_sets = times_.size();
    if (session.recording) {
        recording.dropped_frame_sets = session.recording->dropped_frame_sets;
        recording.lost_frame_sets = session.recording->lost_frame_sets;
        recording.missing_images = session.recording->missing_images;
    }
    const fs::path own = file("session.toml");
    if (absl::Status written = write_session(made_.session, own); !written.ok()) return written;
    return std::move(made_);
}

constexpr double kSilhouettesFraction = 0.8;  // of the time; the rest is for the video

// A hidden folder next to the video, on the disk that has space for it.
class TemporaryFolder {
  public:
    explicit TemporaryFolder(const fs::path& file) {
        std::error_code error;
        std::string pattern =
            (fs::absolute(file, error).parent_path() / ".kinevox-silhouettes-XXXXXX").string();
        if (::mkdtemp(pattern.data())) path_ = pattern;
    }
    ~TemporaryFolder() {
        std::error_code ignored;
        if (!path_.empty()) fs::remove_all(path_, ignored);
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    const fs::path& path() const { return path_; }

  private:
    fs::path path_;
};

absl::StatusOr<std::string> anonymous_name(const Session& session, const std::string& camera) {
    std::vector<std::string> names;
    for (std::size_t c = 0; c < session.cameras.size(); ++c) {
        if (session.cameras[c].name == camera) return anonymous_camera_name(c);
        names.push_back(session.cameras[c].name);
    }
    if (camera.empty()) return "";
    return absl::NotFoundError(fmt::format("session \"{}\" has no camera \"{}\"; it has {}", session.name,
                                           camera, fmt::join(names, ", ")));
}

}  // namespace

std::string anonymous_camera_name(std::size_t camera) {
    return fmt::format("cam_{:02}", camera + 1);
}

absl::StatusOr<AnonymousSession> write_anonymous_session(const Session& session,
                                                         const MeasuredTrials& measured,
                                                         const fs::path& folder, bool one_thread,
                                                         const JobControl& work) {
    const std::int64_t frame_sets = *std::ranges::max_element(measured.trials.front().session_frames) + 1;
    AnonymousFolder made(session, measured, folder);
    if (absl::Status opened = made.open(session, static_cast<std::size_t>(frame_sets)); !opened.ok())
        return opened;
    const auto take = [&](const FrameResult& result) { return made.add(result); };
    const SilhouettePassOptions options{frame_sets, std::max(measured.max_at_once, 1), one_thread};
    if (absl::Status found = find_silhouettes(session, options, take, work); !found.ok()) return found;
    if (absl::Status added = made.add_tables(); !added.ok()) return added;
    return made.close(session);
}

absl::StatusOr<ExportedFiles> export_anonymous(const Session& session, const MeasuredTrials& measured,
                                               std::span<const Trial> slices, const ExportOptions& options,
                                               const fs::path& out, const JobControl& work) {
    const auto camera = anonymous_name(session, options.camera);
    if (!camera.ok()) return camera.status();
    ExportedFiles written;
    written.frames = static_cast<std::int64_t>(slices.front().size());
    written.rate_hz = slices.front().rate_hz;
    const OverlayOptions overlay{.camera = *camera, .width_px = options.width_px, .silhouettes = true};
    const JobControl silhouettes = work.subrange(0, kSilhouettesFraction),
                     drawing = work.subrange(kSilhouettesFraction, 1);
    if (options.format == ExportFormat::kMp4) {
        const TemporaryFolder temporary(out);
        if (temporary.path().empty())
            return absl::UnavailableError(
                fmt::format("{}: its folder is not writable; correct the path", out.string()));
        const auto made =
            write_anonymous_session(session, measured, temporary.path(), options.low_priority, silhouettes);
        if (!made.ok()) return made.status();
        written.files.push_back(out);
        if (absl::Status done = write_overlay_video(made->session, slices, overlay, out, drawing); !done.ok())
            return done;
        return written;
    }
    auto made = write_anonymous_session(session, measured, out, options.low_priority, silhouettes);
    if (!made.ok()) return made.status();
    const fs::path video = out / "video.mp4", readme = out / "README.txt";
    if (absl::Status done = write_overlay_video(made->session, slices, overlay, video, drawing); !done.ok())
        return done;
    if (absl::Status done = write_file_atomically(readme, anonymous_readme()); !done.ok()) return done;
    written.files = std::move(made->files);
    written.files.push_back(video);
    written.files.push_back(readme);
    return written;
}

std::string anonymous_readme() {
    return R"(A motion capture without images, written by `kinevox export --anonymous`.

Contents
  video.mp4           the silhouettes with the measured skeleton
  session.toml        a Kinevox recording: `kinevox process`, `export` and `replay` read it
  cam_NN.mkv, .index  per camera the subjects' silhouettes, white on black, lossless
  cam_NN_background.mkv  the matching background: black
  calibration.toml    the cameras: metres, pixels (OpenCV's model, aniposelib's form)
  frames.csv          times of the frame sets, relative to the first one
  joints.csv, angles.csv, coordinates.csv, uncertainty.csv, withheld.csv, body.toml
                      the measured poses: metres, degrees
  volumes.kvxv        the volumes of each frame set, carved from the silhouettes

Removed
  images of the cameras and of the background, all colours, the names of recording, subject and cameras, date and time of
  day, the certificate of the calibration

What still identifies the subject
  Body shape, measurements and movement are personal. Anyone who already has them, or the images, can identify the
  subject: this data is pseudonymous, and data protection law may still apply.
)";
}

}  // namespace kinevox
