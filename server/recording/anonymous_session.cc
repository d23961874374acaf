#include "server/recording/anonymous_session.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <memory>
#include <span>
#include <system_error>
#include <utility>

#include "common/atomic_file.h"
#include "common/calibration_file.h"
#include "common/recording_files.h"
#include "common/volume_codec.h"
#include "server/cameras/recorded_session.h"
#include "server/recording/background_files.h"
#include "server/recording/image_encoder.h"
#include "server/recording/silhouette_pass.h"
#include "server/recording/video_file.h"
#include "server/recording/volume_file.h"
#include "server/silhouettes/main_subject.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

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
    AnonymousFolder(const Session& session, fs::path folder) : folder_(std::move(folder)) {
        made_.session.name = kAnonymous;
        made_.session.fps = session.fps;
        made_.session.calibration = file("calibration.toml");
        made_.session.recording.emplace();
    }

    absl::Status open(const Session& session, std::size_t frame_sets);
    absl::Status add(const FrameResult& result);
    absl::Status add_tables(const Trial& trial);
    absl::StatusOr<AnonymousSession> close(const Session& session);

  private:
    fs::path file(const std::string& name) {
        made_.files.push_back(folder_ / name);
        return made_.files.back();
    }
    absl::Status open_videos();
    absl::Status write_backgrounds();

    const fs::path folder_;
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
    auto volumes = VolumeFile::create(recording.volumes);
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

absl::Status AnonymousFolder::add(const FrameResult& result) {
    const std::size_t frame = added_++;
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        const kernels::Silhouettes& seen = result.silhouettes[c];
        Image image;  // stays empty if the camera delivered no image
        if (!seen.sharp.empty())
            image = grey_image(seen.width, seen.height, main_subject(seen.sharp, seen.width, seen.height));
        const auto encoded = encoders_[c]->encode(image, true);
        if (!encoded.ok()) return encoded.status();
        if (absl::Status written = videos_[c]->append(**encoded, times_[frame].time_ns); !written.ok())
            return written;
    }
    if (!result.volume) return absl::OkStatus();
    Volume volume = *result.volume;
    volume.colours.clear();
    return volumes_->append(frame, encode_volume(volume));
}

// The trial's own tables, which contain only numbers; the body is rewritten, since users may add comments.
absl::Status AnonymousFolder::add_tables(const Trial& trial) {
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

}  // namespace

std::string anonymous_camera_name(std::size_t camera) {
    return fmt::format("cam_{:02}", camera + 1);
}

absl::StatusOr<AnonymousSession> write_anonymous_session(const Session& session, const Trial& trial,
                                                         const fs::path& folder, bool one_thread,
                                                         const JobControl& work) {
    const std::int64_t frame_sets = *std::ranges::max_element(trial.session_frames) + 1;
    AnonymousFolder made(session, folder);
    if (absl::Status opened = made.open(session, static_cast<std::size_t>(frame_sets)); !opened.ok())
        return opened;
    const auto take = [&](const FrameResult& result) { return made.add(result); };
    if (absl::Status found = find_silhouettes(session, {frame_sets, one_thread}, take, work); !found.ok())
        return found;
    if (absl::Status added = made.add_tables(trial); !added.ok()) return added;
    return made.close(session);
}

}  // namespace kinevox
