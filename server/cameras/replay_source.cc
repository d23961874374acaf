#include "server/cameras/replay_source.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <optional>
#include <thread>
#include <utility>

#include "server/cameras/session_files.h"

namespace kinevox {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kReplayBytesAhead = std::size_t{64} << 20;
constexpr std::size_t kAheadPaused = 2;
constexpr std::chrono::milliseconds kMaxReplayDelay{500};  // then the time base is reset

class LanedReplay final : public ReplaySource {
  public:
    LanedReplay(SessionFiles files, std::int64_t frames, const ReplayOptions& options)
        : files_(std::move(files)),
          frames_(frames),
          lanes_(files_.images.size()),
          playing_(!options.paused),
          loop_(options.loop),
          speed_(options.speed) {
        ahead_ = options.frames_ahead > 0
                     ? static_cast<std::size_t>(options.frames_ahead)
                     : std::clamp<std::size_t>(kReplayBytesAhead / frame_set_bytes(cameras()), 2, 16);
    }
    ~LanedReplay() override {
        stop();
        for (Lane& lane : lanes_)
            if (lane.thread.joinable()) lane.thread.join();
    }

    const std::vector<Camera>& cameras() const override { return files_.cameras; }
    double fps() const override { return files_.session.fps; }
    std::int64_t frame_count() const override { return -1; }  // endless
    absl::StatusOr<std::vector<std::vector<Image>>> background() override {
        return read_backgrounds(files_.session, files_.cameras);
    }
    absl::StatusOr<FrameSet> next() override;
    void stop() override {
        change([&] { stopped_ = true; });
    }

    void play() override {
        change([&] {
            if (ended_) target_ = 0;
            playing_ = true, ended_ = false;
            anchor_.reset();
        });
    }
    void pause() override {
        change([&] { playing_ = false; });
    }
    void step(std::int64_t frames) override {
        change([&] {
            playing_ = false;
            // Also from a target whose images are still being decoded, as when keys follow each other fast.
            const std::int64_t from =
                target_ ? *target_ : wanted_.value_or(std::max<std::int64_t>(shown_, 0));
            // Clamped before the addition: clients may ask for any number of frames.
            target_ = from + std::clamp<std::int64_t>(frames, -from, frames_ - 1 - from);
        });
    }
    absl::Status seek(std::int64_t frame) override;
    absl::Status set_speed(double speed) override;
    void set_loop(bool loop) override {
        change([&] {
            loop_ = loop;
            if (loop && ended_) playing_ = true, ended_ = false;
        });
    }
    std::int64_t frame_at(double position_s) const override { return files_.times.nearest(position_s); }
    ReplayPosition position() const override;

  private:
    // A camera's decoding thread and its decoded images.
    struct Lane {
        std::thread thread;
        std::uint64_t epoch = 0;                                           // of the queue
        std::deque<std::pair<std::int64_t, absl::StatusOr<Image>>> queue;  // frame and image
        std::int64_t at = 0;                                               // next to decode
        bool over = false;                                                 // no more entries follow
    };
    struct Anchor {
        std::int64_t frame = 0;
        Clock::time_point time;
    };

    template <class Change>
    void change(Change what) {
        const std::scoped_lock lock(mutex_);
        what();
        changed_.notify_all();
    }
    std::chrono::nanoseconds time_of(std::int64_t frame) const {
        return std::chrono::nanoseconds(files_.times.of(frame));
    }
    Clock::time_point due(std::int64_t frame) const {  // mutex held; with an anchor
        const double since_ns =
            static_cast<double>((time_of(frame) - time_of(anchor_->frame)).count()) / speed_;
        return anchor_->time + std::chrono::nanoseconds(std::llround(since_ns));
    }
    void decode(std::size_t c);
    bool may_go_ahead(const Lane& lane) const;  // mutex held
    void begin_at(std::int64_t frame);          // mutex held, as in the following
    bool decoded(std::int64_t frame) const;     // by all cameras, or one has an error
    absl::StatusOr<FrameSet> take(std::int64_t frame);
    void skip_late(Clock::time_point now);

    const SessionFiles files_;  // each camera's images are read by its own thread
    const std::int64_t frames_;
    std::size_t ahead_ = 2;
    std::deque<Lane> lanes_;

    mutable std::mutex mutex_;  // guards everything below and the lanes, but not their readers
    std::condition_variable changed_;
    bool started_ = false, stopped_ = false;
    bool playing_, loop_, ended_ = false;
    double speed_;
    std::optional<std::int64_t> target_;  // to be shown as soon as possible
    std::optional<std::int64_t> wanted_;  // a former target that is being decoded
    std::optional<Anchor> anchor_;        // time base of the playback; empty: set by the next frame
    std::int64_t at_ = 0;                 // frame after the one shown last
    std::int64_t shown_ = -1;
    bool discontinuous_ = false;  // the next frame does not follow the last one
    std::uint64_t epoch_ = 1, sequence_ = 0, discontinuity_count_ = 0;
};

absl::Status LanedReplay::seek(std::int64_t frame) {
    if (frame < 0 || frame >= frames_)
        return absl::OutOfRangeError(
            fmt::format("frame {} is out of range; the recording has frames 0 to {}", frame, frames_ - 1));
    change([&] {
        target_ = frame;
        ended_ = false;
    });
    return absl::OkStatus();
}

absl::Status LanedReplay::set_speed(double speed) {
    if (!(speed >= kMinSpeed && speed <= kMaxSpeed))
        return absl::OutOfRangeError(
            fmt::format("speed is {}; {} to {} is allowed (1: as recorded)", speed, kMinSpeed, kMaxSpeed));
    change([&] {
        speed_ = speed;
        anchor_.reset();
    });
    return absl::OkStatus();
}

ReplayPosition LanedReplay::position() const {
    const std::scoped_lock lock(mutex_);
    ReplayPosition out;
    out.state = ended_ ? ReplayState::kEnded : playing_ ? ReplayState::kPlaying : ReplayState::kPaused;
    out.frame = shown_;
    out.frame_count = frames_;
    out.position_s = shown_ < 0 ? 0 : 1e-9 * static_cast<double>(time_of(shown_).count());
    out.nominal_fps = fps();
    out.speed = speed_;
    out.loop = loop_;
    out.discontinuity_count = discontinuity_count_;
    return out;
}

void LanedReplay::begin_at(std::int64_t frame) {
    at_ = frame;
    ++epoch_;
    discontinuous_ = shown_ >= 0 && frame != shown_ + 1;
    anchor_.reset();
    changed_.notify_all();
}

void LanedReplay::decode(std::size_t c) {
    Lane& lane = lanes_[c];
    ImageReader& images = *files_.images[c];
    std::unique_lock lock(mutex_);
    for (;;) {
        changed_.wait(lock,
                      [&] { return stopped_ || lane.epoch != epoch_ || (!lane.over && may_go_ahead(lane)); });
        if (stopped_) return;
        bool sought = false;
        if (lane.epoch != epoch_) {
            lane.epoch = epoch_;
            lane.queue.clear();
            lane.at = at_;
            lane.over = false;
            sought = true;
        }
        if (lane.at >= frames_) {
            lane.over = true;
            continue;
        }
        const std::uint64_t epoch = lane.epoch;
        const std::int64_t frame = lane.at;
        lock.unlock();
        const absl::Status there = sought ? images.seek(frame) : absl::OkStatus();
        auto image = there.ok() ? images.next() : absl::StatusOr<Image>(there);
        lock.lock();
        if (epoch != epoch_) continue;  // another seek came in the meantime
        lane.over = !image.ok();
        lane.queue.emplace_back(frame, std::move(image));
        lane.at = frame + 1;
        changed_.notify_all();
    }
}

// Decodes ahead only when the current frame set is decoded by all cameras, since that needs the cores; and
// only a little while paused, since playback may continue elsewhere.
bool LanedReplay::may_go_ahead(const Lane& lane) const {
    if (lane.queue.size() >= (playing_ ? ahead_ : std::min(ahead_, kAheadPaused))) return false;
    return lane.queue.empty() || std::ranges::all_of(lanes_, [&](const Lane& other) {
               return other.over || (other.epoch == epoch_ && !other.queue.empty());
           });
}

bool LanedReplay::decoded(std::int64_t frame) const {
    return std::ranges::all_of(lanes_, [&](const Lane& lane) {
        return lane.epoch == epoch_ && !lane.queue.empty() && lane.queue.front().first == frame;
    });
}

absl::StatusOr<FrameSet> LanedReplay::take(std::int64_t frame) {
    for (std::size_t c = 0; c < lanes_.size(); ++c)
        if (const auto& image = lanes_[c].queue.front().second; !image.ok())
            return absl::IsOutOfRange(image.status())  // fewer frames than the file declares
                       ? absl::DataLossError(
                             fmt::format("camera {}: its video ends before frame {}; copy it again",
                                         cameras()[c].name, frame))
                       : image.status();
    FrameSet set;
    set.sequence = sequence_++;
    set.capture_time_ns = time_of(frame).count();
    set.recorded_frame = frame;
    set.after_discontinuity = std::exchange(discontinuous_, false);
    discontinuity_count_ += set.after_discontinuity;
    for (Lane& lane : lanes_) {
        set.images.push_back(*std::move(lane.queue.front().second));
        lane.queue.pop_front();
    }
    shown_ = frame;
    at_ = frame + 1;
    changed_.notify_all();
    return set;
}

// Skips frame sets whose successor is decoded and already due.
void LanedReplay::skip_late(Clock::time_point now) {
    while (at_ + 1 < frames_ && due(at_ + 1) <= now && std::ranges::all_of(lanes_, [](const Lane& lane) {
               return lane.queue.size() > 1 && lane.queue[1].second.ok();
           })) {
        for (Lane& lane : lanes_) lane.queue.pop_front();
        ++at_, ++sequence_;
        changed_.notify_all();
    }
    if (now - due(at_) > kMaxReplayDelay) anchor_ = Anchor{at_, now};
}

absl::StatusOr<FrameSet> LanedReplay::next() {
    std::unique_lock lock(mutex_);
    if (!started_ && !stopped_) {
        started_ = true;
        if (!target_) target_ = 0;
        for (std::size_t c = 0; c < lanes_.size(); ++c)
            lanes_[c].thread = std::thread([this, c] { decode(c); });
    }
    for (;;) {
        if (stopped_) return absl::CancelledError("the replay was stopped");
        if (target_) {
            wanted_ = std::exchange(target_, std::nullopt);
            if (*wanted_ != at_ || shown_ < 0) begin_at(*wanted_);
        }
        if (!wanted_) {
            if (playing_ && at_ >= frames_) {
                if (loop_)
                    begin_at(0);
                else
                    playing_ = false, ended_ = true;
            }
            if (!playing_) {
                changed_.wait(lock);
                continue;
            }
        }
        if (!decoded(at_)) {
            changed_.wait(lock);
            continue;
        }
        const Clock::time_point now = Clock::now();
        if (!wanted_ && anchor_) {
            skip_late(now);
            if (const auto when = due(at_); when > now) {
                changed_.wait_until(lock, when);
                continue;
            }
        }
        if (!anchor_) anchor_ = Anchor{at_, now};
        auto set = take(at_);
        wanted_.reset();
        if (set.ok() && at_ >= frames_ && !loop_ && playing_) playing_ = false, ended_ = true;
        return set;
    }
}

}  // namespace

absl::StatusOr<std::shared_ptr<ReplaySource>> ReplaySource::open(const std::filesystem::path& session_file,
                                                                 const ReplayOptions& options) {
    if (!(options.speed >= kMinSpeed && options.speed <= kMaxSpeed) || options.frames_ahead < 0)
        return absl::InvalidArgumentError(fmt::format(
            "replay: speed is {}, frames_ahead is {}; speed must be {} to {}, frames_ahead 0 or more",
            options.speed, options.frames_ahead, kMinSpeed, kMaxSpeed));
    auto files = open_session_files(session_file);
    if (!files.ok()) return files.status();
    const auto frames = count_frame_sets(*files);
    if (!frames.ok()) return frames.status();
    return std::make_shared<LanedReplay>(*std::move(files), *frames, options);
}

}  // namespace kinevox
