#include "server/cameras/session_source.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <condition_variable>
#include <cstdlib>
#include <limits>
#include <deque>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <opencv2/core/utils/logger.hpp>

#include "common/background_priority.h"
#include "common/session_offsets.h"
#include "server/cameras/picture_reader.h"
#include "server/cameras/recorded_session.h"
#include "server/cameras/recorded_video.h"

namespace kinevox {
namespace {

using SteadyClock = std::chrono::steady_clock;

constexpr std::size_t kBytesAhead = std::size_t{128} << 20;
constexpr std::size_t kBackgroundBytes = std::size_t{512} << 20;
constexpr std::size_t kMostBackgroundPictures = 64;  // twice the default N

std::size_t frame_set_bytes(const std::vector<Camera>& cameras) {
    std::size_t bytes = 0;
    for (const Camera& camera : cameras) bytes += std::size_t{3} * camera.width * camera.height;
    return std::max<std::size_t>(bytes, 1);
}

// Up to `most` pictures of the empty scene, spread over the file.
absl::StatusOr<std::vector<Picture>> read_background(const std::filesystem::path& file, const Camera& camera,
                                                     std::size_t most) {
    auto reader = open_pictures(file, camera);
    if (!reader.ok()) return reader.status();
    const std::int64_t promised = (*reader)->promised();
    const std::int64_t step =
        std::max<std::int64_t>(1, promised / static_cast<std::int64_t>(std::min<std::size_t>(most, 1 << 30)));
    std::vector<Picture> pictures;
    for (std::int64_t n = 0; pictures.size() < most; ++n) {
        auto picture = (*reader)->next();
        if (absl::IsOutOfRange(picture.status())) break;
        if (!picture.ok()) return picture.status();
        if (n % step == 0) pictures.push_back(std::move(*picture));
    }
    return pictures;
}

class SessionSource final : public FrameSource {
  public:
    SessionSource(Session session, std::vector<Camera> cameras, const SessionSourceOptions& options)
        : session_(std::move(session)), cameras_(std::move(cameras)), options_(options), first_(first_pictures(session_)) {
        const std::size_t fit = kBytesAhead / frame_set_bytes(cameras_);
        capacity_ = options_.frames_ahead > 0 ? static_cast<std::size_t>(options_.frames_ahead)
                                              : std::clamp<std::size_t>(fit, 2, 32);
    }

    ~SessionSource() override {
        stop();
        for (Lane& lane : lanes_)
            if (lane.thread.joinable()) lane.thread.join();
    }

    absl::Status open() {
        if (session_.recording) return open_recording();
        for (std::size_t c = 0; c < cameras_.size(); ++c) {
            auto reader = open_pictures(session_.cameras[c].video, cameras_[c]);
            if (!reader.ok()) return reader.status();
            lanes_.emplace_back().reader = std::move(*reader);
        }
        return has_offsets(session_) ? find_common_length() : check_lengths();
    }

    const std::vector<Camera>& cameras() const override { return cameras_; }
    double fps() const override { return session_.fps; }

    std::int64_t frame_count() const override {
        if (options_.loop) return -1;
        std::int64_t count = -1;
        for (std::size_t c = 0; c < lanes_.size(); ++c) {
            const std::int64_t promised = lanes_[c].reader->promised() - first_[c];
            if (promised > 0 && (count < 0 || promised < count)) count = promised;
        }
        return count;
    }

    absl::StatusOr<std::vector<std::vector<Picture>>> background() override;
    absl::StatusOr<FrameSet> next() override;

    void stop() override {
        const std::lock_guard lock(mutex_);
        stopped_ = true;
        changed_.notify_all();
    }

  private:
    // A camera's reader, its thread and the queue between that thread and next().
    struct Lane {
        std::unique_ptr<PictureReader> reader;
        std::thread thread;
        std::deque<absl::StatusOr<Picture>> queue;  // an error is the last entry
        bool ended = false;                         // nothing will be added
    };

    absl::Status open_recording();
    absl::Status check_lengths() const;
    absl::Status find_common_length();
    absl::StatusOr<Picture> next_picture(std::size_t c, std::int64_t taken);
    absl::Status uneven_end(std::size_t ended_camera) const;
    void decode(std::size_t c);
    absl::StatusOr<FrameSet> take_set(std::unique_lock<std::mutex>& lock);
    bool all_full() const;
    std::chrono::nanoseconds recording_time(std::uint64_t sequence) const {
        if (!times_.empty()) {
            const std::uint64_t rounds = sequence / times_.size(), frame = sequence % times_.size();
            const auto round = std::chrono::nanoseconds(times_.back().time_ns + std::llround(1e9 / session_.fps));
            return static_cast<std::int64_t>(rounds) * round + std::chrono::nanoseconds(times_[frame].time_ns);
        }
        return std::chrono::nanoseconds(std::llround(1e9 * static_cast<double>(sequence) / session_.fps));
    }

    Session session_;
    std::vector<Camera> cameras_;
    SessionSourceOptions options_;
    std::size_t capacity_ = 2;
    std::vector<std::int64_t> first_;   // per camera: the picture that belongs to the first frame set
    std::int64_t length_ = -1;          // frame sets, where the videos have offsets and tell their lengths
    std::vector<RecordedTime> times_;   // of a recording's frame sets; empty: evenly spaced
    std::deque<Lane> lanes_;

    std::mutex mutex_;  // of everything below and the lanes' queues
    std::condition_variable changed_;
    bool started_ = false, stopped_ = false;
    bool filling_ = true;
    std::uint64_t sequence_ = 0;
    SteadyClock::time_point start_;
};

// What the recorder wrote, perhaps cut off: as far as all cameras have it.
absl::Status SessionSource::open_recording() {
    auto times = whole_frame_sets(session_);
    if (!times.ok()) return times.status();
    times_ = *std::move(times);
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        auto video = RecordedVideo::open(session_.cameras[c].video, cameras_[c], static_cast<std::int64_t>(times_.size()));
        if (!video.ok()) return video.status();
        lanes_.emplace_back().reader = *std::move(video);
    }
    return absl::OkStatus();
}

absl::Status SessionSource::check_lengths() const {
    std::size_t shortest = 0, longest = 0;
    for (std::size_t c = 0; c < lanes_.size(); ++c) {
        if (!lanes_[c].reader->promise_is_exact()) return absl::OkStatus();  // next() will notice
        if (lanes_[c].reader->promised() < lanes_[shortest].reader->promised()) shortest = c;
        if (lanes_[c].reader->promised() > lanes_[longest].reader->promised()) longest = c;
    }
    const std::int64_t fewest = lanes_[shortest].reader->promised(), most = lanes_[longest].reader->promised();
    if (fewest == most) return absl::OkStatus();
    return absl::InvalidArgumentError(fmt::format(
        "camera {}: {} has {} frames, that of camera {} has {}; all cameras of a session need the same number: "
        "copy the file again or cut all to {} frames",
        cameras_[shortest].name, session_.cameras[shortest].video.string(), fewest, cameras_[longest].name, most,
        fewest));
}

absl::Status SessionSource::find_common_length() {
    std::vector<std::int64_t> pictures;
    for (std::size_t c = 0; c < lanes_.size(); ++c) {
        const PictureReader& reader = *lanes_[c].reader;
        if (reader.promise_is_exact()) {
            pictures.push_back(reader.promised());
            continue;
        }
        if (!options_.loop) return absl::OkStatus();   // next() will notice the end
        return absl::InvalidArgumentError(
            fmt::format("camera {}: {} does not tell exactly how many frames it has, so that cameras with offset_s cannot "
                        "begin anew together; convert it to MP4 with ffmpeg",
                        cameras_[c].name, session_.cameras[c].video.string()));
    }
    const auto length = common_length(session_, pictures);
    if (length.ok()) length_ = *length;
    return length.status();
}

absl::StatusOr<std::vector<std::vector<Picture>>> SessionSource::background() {
    const std::size_t count = cameras_.size();
    // The recorder kept what a background was learned from, and all of it makes the same again.
    const std::size_t most =
        session_.recording
            ? std::numeric_limits<std::size_t>::max()
            : std::clamp<std::size_t>(kBackgroundBytes / frame_set_bytes(cameras_), 8, kMostBackgroundPictures);
    const bool any = std::any_of(session_.cameras.begin(), session_.cameras.end(),
                                 [](const SessionCamera& camera) { return !camera.background.empty(); });
    if (!any) return std::vector<std::vector<Picture>>{};
    std::vector<absl::StatusOr<std::vector<Picture>>> read(count, std::vector<Picture>{});
    {
        std::vector<std::jthread> threads;
        for (std::size_t c = 0; c < count; ++c)
            if (!session_.cameras[c].background.empty())
                threads.emplace_back([this, &read, c, most] {
                    read[c] = read_background(session_.cameras[c].background, cameras_[c], most);
                });
    }
    std::vector<std::vector<Picture>> pictures;
    for (auto& one : read) {
        if (!one.ok()) return one.status();
        pictures.push_back(std::move(*one));
    }
    return pictures;
}

bool SessionSource::all_full() const {
    return std::all_of(lanes_.begin(), lanes_.end(),
                       [this](const Lane& lane) { return lane.ended || lane.queue.size() >= capacity_; });
}

// `taken` were handed out since the video's begin.
absl::StatusOr<Picture> SessionSource::next_picture(std::size_t c, std::int64_t taken) {
    if (length_ >= 0 && taken >= length_) return absl::OutOfRangeError("the cameras' common time has ended");
    if (taken == 0 && first_[c] > 0)
        if (absl::Status there = lanes_[c].reader->seek(first_[c]); !there.ok()) return there;
    return lanes_[c].reader->next();
}

void SessionSource::decode(std::size_t c) {
    // The next set is decoded while this one is computed, and has a frame's time for it.
    lower_this_threads_priority();
    Lane& lane = lanes_[c];
    std::int64_t taken = 0;   // since it was opened or rewound
    bool fresh = false;  // rewound and nothing read since
    for (;;) {
        {
            std::unique_lock lock(mutex_);
            changed_.wait(lock, [&] { return stopped_ || (filling_ && lane.queue.size() < capacity_); });
            if (stopped_) return;
        }
        auto picture = next_picture(c, taken);
        if (options_.loop && absl::IsOutOfRange(picture.status()) && !fresh) {
            if (absl::Status rewound = lane.reader->rewind(); rewound.ok()) {
                fresh = true;
                taken = 0;
                continue;
            } else {
                picture = rewound;
            }
        }
        fresh = false;
        ++taken;
        const std::lock_guard lock(mutex_);
        lane.ended = !picture.ok();
        lane.queue.push_back(std::move(picture));
        if (options_.decode_in_bursts && all_full()) filling_ = false;
        changed_.notify_all();
        if (lane.ended) return;
    }
}

absl::Status SessionSource::uneven_end(std::size_t ended_camera) const {
    return absl::DataLossError(fmt::format(
        "camera {}: {} ends after {} frames, the other cameras go on; all cameras of a session need the same "
        "number: copy the file again or cut all to {} frames",
        cameras_[ended_camera].name, session_.cameras[ended_camera].video.string(), sequence_, sequence_));
}

absl::StatusOr<FrameSet> SessionSource::take_set(std::unique_lock<std::mutex>& lock) {
    const auto any_empty = [this] {
        return std::any_of(lanes_.begin(), lanes_.end(), [](const Lane& lane) { return lane.queue.empty(); });
    };
    if (options_.decode_in_bursts && any_empty()) {
        filling_ = true;
        changed_.notify_all();
        changed_.wait(lock, [&] { return stopped_ || !filling_ || all_full(); });
    }
    changed_.wait(lock, [&] { return stopped_ || !any_empty(); });
    if (stopped_) return absl::CancelledError("the session source was stopped");

    // A damaged file is told before the uneven end that it causes.
    for (const Lane& lane : lanes_)
        if (!lane.queue.front().ok() && !absl::IsOutOfRange(lane.queue.front().status()))
            return lane.queue.front().status();
    std::size_t ended = 0, ended_camera = 0;
    for (std::size_t c = 0; c < lanes_.size(); ++c)
        if (!lanes_[c].queue.front().ok()) ++ended, ended_camera = c;
    if (ended == lanes_.size()) return absl::OutOfRangeError("the session has ended");
    if (ended > 0 && has_offsets(session_)) return absl::OutOfRangeError("the session has ended with its first video");
    if (ended > 0) return uneven_end(ended_camera);

    FrameSet set;
    set.sequence = sequence_++;
    for (Lane& lane : lanes_) {
        set.pictures.push_back(std::move(*lane.queue.front()));
        lane.queue.pop_front();
    }
    changed_.notify_all();
    return set;
}

absl::StatusOr<FrameSet> SessionSource::next() {
    std::unique_lock lock(mutex_);
    if (stopped_) return absl::CancelledError("the session source was stopped");
    if (!started_) {
        started_ = true;
        for (std::size_t c = 0; c < lanes_.size(); ++c) lanes_[c].thread = std::thread([this, c] { decode(c); });
    }
    for (;;) {
        auto set = take_set(lock);
        if (!set.ok()) return set;
        const std::chrono::nanoseconds time = recording_time(set->sequence);
        if (options_.pacing == Pacing::kAsFastAsPossible) {
            set->capture_time_ns = time.count();
            return set;
        }
        if (set->sequence == 0) start_ = SteadyClock::now();
        const SteadyClock::time_point due = start_ + time;
        // A set whose successor is due as well comes too late to matter: it shows as a gap.
        if (SteadyClock::now() > start_ + recording_time(set->sequence + 1)) continue;
        if (changed_.wait_until(lock, due, [this] { return stopped_; }))
            return absl::CancelledError("the session source was stopped");
        set->capture_time_ns = due.time_since_epoch().count();
        return set;
    }
}

}  // namespace

absl::StatusOr<std::unique_ptr<FrameSource>> open_session_source(const Session& session,
                                                                 const SessionSourceOptions& options) {
    if (options.frames_ahead < 0)
        return absl::InvalidArgumentError(fmt::format(
            "frames_ahead is {}; it must be 0 (chosen by memory) or more", options.frames_ahead));
    auto cameras = read_session_cameras(session);
    if (!cameras.ok()) return cameras.status();
    auto source = std::make_unique<SessionSource>(session, std::move(*cameras), options);
    if (absl::Status opened = source->open(); !opened.ok()) return opened;
    return source;
}

absl::StatusOr<std::unique_ptr<FrameSource>> open_session_source(const std::filesystem::path& session_file,
                                                                 const SessionSourceOptions& options) {
    repair_recording(session_file).IgnoreError();   // can be read without
    auto session = read_session(session_file);
    if (!session.ok()) return session.status();
    return open_session_source(*session, options);
}

absl::StatusOr<std::vector<std::vector<Picture>>> background_of_all(FrameSource& source,
                                                                    const std::filesystem::path& session_file) {
    auto background = source.background();
    if (!background.ok()) return background.status();
    const std::vector<Camera>& cameras = source.cameras();
    for (std::size_t c = 0; c < cameras.size(); ++c)
        if (c >= background->size() || (*background)[c].empty())
            return absl::InvalidArgumentError(
                fmt::format("{}: camera {} has no `background`; add a picture, a clip or a folder of the empty scene",
                            session_file.string(), cameras[c].name));
    return background;
}

void silence_video_libraries() {
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", /*overwrite=*/0);  // AV_LOG_QUIET; OpenCV reads it at first use
}

}  // namespace kinevox
