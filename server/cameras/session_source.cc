#include "server/cameras/session_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <cstdlib>
#include <deque>
#include <mutex>
#include <opencv2/core/utils/logger.hpp>
#include <thread>
#include <utility>
#include <vector>

#include "common/background_priority.h"
#include "server/cameras/libav.h"
#include "server/cameras/session_files.h"

namespace kinevox {
namespace {

using SteadyClock = std::chrono::steady_clock;

constexpr std::size_t kBytesAhead = std::size_t{128} << 20;
constexpr std::chrono::milliseconds kMaxDelay{500};  // behind real time; then the time base is reset

class SessionSource final : public FrameSource {
  public:
    SessionSource(SessionFiles files, const SessionSourceOptions& options)
        : files_(std::move(files)), options_(options), lanes_(files_.images.size()) {
        const std::size_t fit = kBytesAhead / frame_set_bytes(files_.cameras);
        capacity_ = options_.frames_ahead > 0 ? static_cast<std::size_t>(options_.frames_ahead)
                                              : std::clamp<std::size_t>(fit, 2, 32);
    }

    ~SessionSource() override {
        stop();
        for (Lane& lane : lanes_)
            if (lane.thread.joinable()) lane.thread.join();
    }

    const std::vector<Camera>& cameras() const override { return files_.cameras; }
    double fps() const override { return files_.session.fps; }

    std::int64_t frame_count() const override {
        if (options_.loop) return -1;
        std::int64_t count = -1;
        for (const auto& images : files_.images) {
            const std::int64_t promised = images->promised();
            if (promised > 0 && (count < 0 || promised < count)) count = promised;
        }
        return count;
    }

    absl::StatusOr<std::vector<std::vector<Image>>> background() override {
        return read_backgrounds(files_.session, files_.cameras);
    }
    absl::StatusOr<FrameSet> next() override;

    void stop() override {
        const std::lock_guard lock(mutex_);
        stopped_ = true;
        changed_.notify_all();
    }

  private:
    // A camera's decoding thread and its queue to next().
    struct Lane {
        std::thread thread;
        std::deque<absl::StatusOr<Image>> queue;  // an error is the last entry
        bool ended = false;                       // no more entries follow
    };

    absl::Status uneven_end(std::size_t ended_camera) const;
    void decode(std::size_t c);
    absl::StatusOr<FrameSet> take_set(std::unique_lock<std::mutex>& lock);
    bool all_full() const;
    bool none_empty() const {
        return std::ranges::none_of(lanes_, [](const Lane& lane) { return lane.queue.empty(); });
    }
    std::chrono::nanoseconds recording_time(std::uint64_t sequence) const {
        return std::chrono::nanoseconds(files_.times.of(static_cast<std::int64_t>(sequence)));
    }

    const SessionFiles files_;  // each camera's images are read by its own thread
    SessionSourceOptions options_;
    std::size_t capacity_ = 2;
    std::deque<Lane> lanes_;

    std::mutex mutex_;  // guards everything below and the lanes' queues
    std::condition_variable changed_;
    bool started_ = false, stopped_ = false;
    bool filling_ = true;
    std::uint64_t sequence_ = 0;
    SteadyClock::time_point start_;
};

bool SessionSource::all_full() const {
    return std::all_of(lanes_.begin(), lanes_.end(),
                       [this](const Lane& lane) { return lane.ended || lane.queue.size() >= capacity_; });
}

void SessionSource::decode(std::size_t c) {
    // Decoding of the next frame set runs in parallel to the processing of this one.
    lower_this_threads_priority();
    Lane& lane = lanes_[c];
    ImageReader& images = *files_.images[c];
    bool fresh = false;  // just rewound
    for (;;) {
        {
            std::unique_lock lock(mutex_);
            changed_.wait(lock, [&] { return stopped_ || (filling_ && lane.queue.size() < capacity_); });
            if (stopped_) return;
        }
        auto image = images.next();
        if (options_.loop && absl::IsOutOfRange(image.status()) && !fresh) {
            if (absl::Status rewound = images.rewind(); rewound.ok()) {
                fresh = true;
                continue;
            } else {
                image = rewound;
            }
        }
        fresh = false;
        const std::lock_guard lock(mutex_);
        lane.ended = !image.ok();
        lane.queue.push_back(std::move(image));
        if (options_.decode_in_bursts && all_full()) filling_ = false;
        changed_.notify_all();
        if (lane.ended) return;
    }
}

absl::Status SessionSource::uneven_end(std::size_t ended_camera) const {
    return absl::DataLossError(fmt::format(
        "camera {}: {} ends after {} frames, the other cameras have more; all cameras of a session need the "
        "same number: copy the file again or trim all to {} frames",
        files_.cameras[ended_camera].name, files_.session.cameras[ended_camera].video.string(), sequence_,
        sequence_));
}

absl::StatusOr<FrameSet> SessionSource::take_set(std::unique_lock<std::mutex>& lock) {
    if (options_.decode_in_bursts && !none_empty()) {
        filling_ = true;
        changed_.notify_all();
        changed_.wait(lock, [&] { return stopped_ || !filling_ || all_full(); });
    }
    changed_.wait(lock, [&] { return stopped_ || none_empty(); });
    if (stopped_) return absl::CancelledError("the session source was stopped");

    // A damaged file is reported rather than the unequal lengths that it causes.
    for (const Lane& lane : lanes_)
        if (!lane.queue.front().ok() && !absl::IsOutOfRange(lane.queue.front().status()))
            return lane.queue.front().status();
    std::size_t ended = 0, ended_camera = 0;
    for (std::size_t c = 0; c < lanes_.size(); ++c)
        if (!lanes_[c].queue.front().ok()) ++ended, ended_camera = c;
    if (ended == lanes_.size()) return absl::OutOfRangeError("the session has ended");
    if (ended > 0) return uneven_end(ended_camera);

    FrameSet set;
    set.sequence = sequence_++;
    for (Lane& lane : lanes_) {
        set.images.push_back(std::move(*lane.queue.front()));
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
        for (std::size_t c = 0; c < lanes_.size(); ++c)
            lanes_[c].thread = std::thread([this, c] { decode(c); });
    }
    for (;;) {
        auto set = take_set(lock);
        if (!set.ok()) return set;
        const std::chrono::nanoseconds time = recording_time(set->sequence);
        if (options_.pacing == Pacing::kAsFastAsPossible) {
            set->capture_time_ns = time.count();
            return set;
        }
        const SteadyClock::time_point now = SteadyClock::now();
        // If decoding is slower than real time, the time base is reset; otherwise every set would be skipped.
        if (set->sequence == 0 || now - (start_ + time) > kMaxDelay) start_ = now - time;
        const SteadyClock::time_point due = start_ + time;
        // Skips a set whose successor is decoded and already due, which shows as a gap.
        if (now > start_ + recording_time(set->sequence + 1) && none_empty()) continue;
        if (changed_.wait_until(lock, due, [this] { return stopped_; }))
            return absl::CancelledError("the session source was stopped");
        set->capture_time_ns = due.time_since_epoch().count();
        return set;
    }
}

absl::StatusOr<std::unique_ptr<FrameSource>> open_session_source(SessionFiles files,
                                                                 const SessionSourceOptions& options) {
    if (options.frames_ahead < 0)
        return absl::InvalidArgumentError(
            fmt::format("frames_ahead is {}; it must be 0 (chosen by memory) or more", options.frames_ahead));
    return std::make_unique<SessionSource>(std::move(files), options);
}

}  // namespace

absl::StatusOr<std::unique_ptr<FrameSource>> open_session_source(const Session& session,
                                                                 const SessionSourceOptions& options) {
    auto files = open_session_files(session);
    if (!files.ok()) return files.status();
    return open_session_source(*std::move(files), options);
}

absl::StatusOr<std::unique_ptr<FrameSource>> open_session_source(const std::filesystem::path& session_file,
                                                                 const SessionSourceOptions& options) {
    auto files = open_session_files(session_file);
    if (!files.ok()) return files.status();
    return open_session_source(*std::move(files), options);
}

absl::StatusOr<std::vector<std::vector<Image>>> background_of_all(FrameSource& source,
                                                                  const std::filesystem::path& session_file) {
    auto background = source.background();
    if (!background.ok()) return background.status();
    if (absl::Status all = each_has_background(*background, source.cameras(), session_file.string());
        !all.ok())
        return all;
    return background;
}

void silence_video_libraries() {
    cv::utils::logging::setLogLevel(cv::utils::logging::LOG_LEVEL_SILENT);
    setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", /*overwrite=*/0);  // AV_LOG_QUIET; OpenCV reads it at first use
    av_log_set_level(AV_LOG_QUIET);
}

}  // namespace kinevox
