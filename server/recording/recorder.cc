#include "server/recording/recorder.h"

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <ctime>
#include <deque>
#include <future>
#include <mutex>
#include <system_error>
#include <thread>
#include <utility>

#include <fmt/format.h>

#include "server/pipeline/utc_clock.h"
#include "server/pose/body_shape.h"
#include "server/recording/encoding_lanes.h"
#include "server/recording/recording_folder.h"
#include "server/recording/recording_writer.h"

namespace kinevox {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kMostQueuedResults = 256;
constexpr std::chrono::milliseconds kLongestWaitForResults{1500}, kWriterBeat{50}, kFinishBeat{5};
constexpr std::chrono::seconds kTellDropsEvery{5}, kLongestClose{5};

std::string name_by_time() {
    const std::time_t now = std::time(nullptr);
    std::tm local{};
    localtime_r(&now, &local);
    char text[64];
    std::strftime(text, sizeof text, "%Y-%m-%d_%H-%M-%S", &local);
    return text;
}

std::string summary(const RecordingInfo& info) {
    std::string text = fmt::format("{} frame sets, {:.1f} s, {} MB", info.about.frames, info.seconds, info.bytes >> 20);
    if (info.about.dropped > 0) text += fmt::format(", {} dropped", info.about.dropped);
    if (info.about.lost > 0) text += fmt::format(", {} lost before", info.about.lost);
    return text;
}

class LiveRecorder final : public Recorder {
  public:
    LiveRecorder(const RecorderOptions& options, std::function<RecordedCapture()> capture, std::function<void(Event)> tell)
        : options_(options), capture_(std::move(capture)), tell_(std::move(tell)),
          writer_(options, [this](const RecordingInfo& info) { failed(info); }),
          clip_(options.folder, [this] {
              const std::scoped_lock lock(mutex_);
              background_changed_ = true;
          }) {
        writer_thread_ = std::jthread([this](const std::stop_token& stop) { write_loop(stop); });
    }
    ~LiveRecorder() override { close(); }
    absl::Status open() {
        return options_.keep_last_s > 0 ? make_lanes(capture_(), options_.codec) : absl::OkStatus();
    }

    void offer(const FrameSet& frame_set) override;
    void observe(const FrameResult& result, const BodyShape* body) override;
    void learned(EmptyScene pictures) override {
        const RecordedCapture capture = capture_();
        clip_.keep(capture.cameras, capture.fps, std::move(pictures));
    }
    void capture_ended() override;
    absl::StatusOr<std::string> start(const std::string& name, std::optional<VideoCodec> codec) override;
    absl::StatusOr<RecordingInfo> stop() override { return finish({}); }
    absl::StatusOr<RecordingInfo> keep_last(const std::string& name, double seconds, bool go_on) override;
    RecorderStatus status() const override;
    const RecorderOptions& options() const override { return options_; }
    void close() override;

  private:
    struct Finish {
        std::uint64_t upto = 0;   // the first set that is not in it
        std::string reason;
        std::optional<std::promise<RecordingInfo>> answer;
        Clock::time_point begun = Clock::now();
    };

    absl::Status check_idle() const;   // mutex held
    absl::StatusOr<std::unique_ptr<RecordingFolder>> make_folder(const std::string& name, VideoCodec codec);
    absl::Status make_lanes(const RecordedCapture& capture, VideoCodec codec);
    void drop_lanes();
    absl::StatusOr<RecordingInfo> finish(std::string reason);
    bool taking() const { return lanes_ != nullptr && (options_.keep_last_s > 0 || recording_); }   // mutex held
    void write_loop(const std::stop_token& stop);
    void finish_if_done();
    void tell_drops();
    void failed(const RecordingInfo& info);
    void ended(const RecordingInfo& info, EventKind kind);

    const RecorderOptions options_;
    const std::function<RecordedCapture()> capture_;
    const std::function<void(Event)> tell_;
    std::mutex requests_;                       // start, stop and keep, one after the other

    mutable std::mutex mutex_;                  // guards the members down to the blank line
    std::condition_variable_any changed_;
    std::unique_ptr<EncodingLanes> lanes_;
    VideoCodec lanes_codec_ = VideoCodec::kUtVideo;
    bool closed_ = false, recording_ = false, key_wanted_ = true;
    std::uint64_t key_distance_ = 1;            // frame sets
    std::uint64_t first_number_ = 0;            // of the recording under way
    std::uint64_t run_ = 0, next_number_ = 0, dropped_ = 0, held_dropped_ = 0, told_dropped_ = 0;
    std::size_t queued_bytes_ = 0;
    std::optional<std::int64_t> utc_minus_capture_ns_;   // of this run
    std::deque<std::shared_ptr<EncodedSet>> done_;
    std::deque<ResultOfSet> results_;
    std::optional<BodyShape> body_;
    bool body_changed_ = false, background_changed_ = false;
    std::function<void()> begin_;               // by the writer's thread, once the sets before it are done
    std::uint64_t begin_at_ = 0;
    std::optional<Finish> finish_;
    RecorderStatus status_;

    RecordingWriter writer_;                    // the writer thread's own
    Clock::time_point drops_told_{};
    BackgroundClip clip_;                       // tells the members above
    std::jthread writer_thread_;
};

void LiveRecorder::offer(const FrameSet& frame_set) {
    std::size_t bytes = 0;
    for (const Picture& picture : frame_set.pictures)
        bytes += static_cast<std::size_t>(picture.width) * static_cast<std::size_t>(picture.height * picture.channels);
    const std::scoped_lock lock(mutex_);
    if (closed_ || !taking()) return;
    if (!utc_minus_capture_ns_) utc_minus_capture_ns_ = utc_minus_capture_ns(frame_set.capture_time_ns);
    if (queued_bytes_ > 0 && queued_bytes_ + bytes > options_.queue_bytes) {
        ++(recording_ ? dropped_ : held_dropped_);
        return;
    }
    auto set = std::make_shared<EncodedSet>();
    set->number = next_number_++;
    set->run = run_;
    set->sequence = frame_set.sequence;
    set->capture_time_ns = frame_set.capture_time_ns;
    set->capture_time_utc_ns = frame_set.capture_time_ns + *utc_minus_capture_ns_;
    set->key = std::exchange(key_wanted_, false) || set->number % key_distance_ == 0;
    set->raw_bytes = bytes;
    queued_bytes_ += bytes;
    lanes_->put(std::move(set), frame_set.pictures);
}

void LiveRecorder::observe(const FrameResult& result, const BodyShape* body) {
    const std::scoped_lock lock(mutex_);
    if (body && body_ != *body) {
        body_ = *body;
        body_changed_ = true;
    }
    if (closed_ || !taking()) return;
    results_.push_back({run_, result.sequence, options_.poses ? result.pose : nullptr,
                        options_.volumes ? result.volume : nullptr});
    if (results_.size() > kMostQueuedResults) results_.pop_front();
    changed_.notify_all();
}

void LiveRecorder::capture_ended() {
    const std::scoped_lock lock(mutex_);
    ++run_;
    utc_minus_capture_ns_.reset();
    held_dropped_ = 0;
    key_wanted_ = true;
    if (recording_ && !finish_ && next_number_ > first_number_) {   // else it waits for the next run
        recording_ = false;
        finish_.emplace(Finish{next_number_, "the capture ended", {}});
    }
    changed_.notify_all();
}

absl::Status LiveRecorder::check_idle() const {
    if (closed_) return absl::UnavailableError("the daemon is stopping");
    if (status_.state == RecorderState::kIdle && !finish_ && !begin_) return absl::OkStatus();
    return absl::FailedPreconditionError(fmt::format("\"{}\" is being recorded; stop that first",
                                                     status_.recording ? status_.recording->name : "another recording"));
}

absl::StatusOr<std::unique_ptr<RecordingFolder>> LiveRecorder::make_folder(const std::string& name, VideoCodec codec) {
    if (options_.folder.empty())
        return absl::FailedPreconditionError("this daemon has no folder for recordings; set [recording] folder");
    if (const std::string problem = recording_name_problem(name); !problem.empty())
        return absl::InvalidArgumentError(problem);
    std::error_code error;
    std::filesystem::create_directories(options_.folder, error);
    if (const auto space = std::filesystem::space(options_.folder, error);
        !error && space.available < options_.least_free_bytes)
        return absl::ResourceExhaustedError(
            fmt::format("{} MB are free on the disk of {}, least_free_mb is {}; make room", space.available >> 20,
                        options_.folder.string(), options_.least_free_bytes >> 20));
    const RecordedCapture capture = capture_();
    RecordingPlan plan;
    plan.folder = options_.folder / name;
    plan.fps = capture.fps;
    plan.codec = codec;
    plan.cameras = capture.cameras;
    // A second or two after learning it is still being written. A recording that were killed before it came would be of
    // no use, so that the begin waits for it.
    plan.background = clip_.files(true);
    plan.calibration_id = capture.calibration_id;
    plan.certificate_json = capture.certificate_json;
    plan.calibration_file = capture.calibration_file;
    plan.poses = options_.poses;
    plan.volumes = options_.volumes;
    if (absl::Status ready = make_lanes(capture, codec); !ready.ok()) return ready;
    {
        const std::scoped_lock lock(mutex_);
        plan.body = body_;
        plan.formats = lanes_->formats();
    }
    auto folder = RecordingFolder::create(plan);
    if (!folder.ok() && options_.keep_last_s == 0) drop_lanes();
    return folder;
}

absl::Status LiveRecorder::make_lanes(const RecordedCapture& capture, VideoCodec codec) {
    {
        const std::scoped_lock lock(mutex_);
        if (lanes_ && lanes_codec_ == codec) return absl::OkStatus();
        if (lanes_ && options_.keep_last_s > 0)
            return absl::FailedPreconditionError(fmt::format(
                "the rolling buffer is kept as {}; record with that, or set keep_last_s = 0", name_of(lanes_codec_)));
    }
    auto lanes = EncodingLanes::create(capture.cameras, capture.fps, codec, [this](std::shared_ptr<EncodedSet> set) {
        const std::scoped_lock lock(mutex_);
        done_.push_back(std::move(set));
        changed_.notify_all();
    });
    if (!lanes.ok()) return lanes.status();
    const std::scoped_lock lock(mutex_);
    lanes_ = *std::move(lanes);
    lanes_codec_ = codec;
    key_distance_ = static_cast<std::uint64_t>(key_distance(codec, capture.fps));
    return absl::OkStatus();
}

// Their threads end outside of the lock, which they need.
void LiveRecorder::drop_lanes() {
    std::unique_ptr<EncodingLanes> dropped;
    const std::scoped_lock lock(mutex_);
    dropped.swap(lanes_);
    queued_bytes_ = 0;
}

absl::StatusOr<std::string> LiveRecorder::start(const std::string& asked, std::optional<VideoCodec> codec) {
    const std::scoped_lock one_request(requests_);
    {
        const std::scoped_lock lock(mutex_);
        if (absl::Status idle = check_idle(); !idle.ok()) return idle;
    }
    const std::string name = asked.empty() ? name_by_time() : asked;
    auto folder = make_folder(name, codec.value_or(options_.codec));
    if (!folder.ok()) return folder.status();
    const std::scoped_lock lock(mutex_);
    status_.state = RecorderState::kWaiting;
    status_.recording = (*folder)->info();
    recording_ = key_wanted_ = true;
    dropped_ = told_dropped_ = 0;
    first_number_ = next_number_;
    begin_at_ = 0;
    begin_ = [this, made = std::make_shared<std::unique_ptr<RecordingFolder>>(*std::move(folder)), first = next_number_] {
        writer_.begin(std::move(*made), first);
    };
    changed_.notify_all();
    tell_({EventKind::kRecordingStarted, 0, 0, {}, fmt::format("recording \"{}\" begins", name)});
    return name;
}

absl::StatusOr<RecordingInfo> LiveRecorder::keep_last(const std::string& asked, double seconds, bool go_on) {
    const std::string name = asked.empty() ? name_by_time() : asked;
    std::future<RecordingInfo> answer;
    {
        const std::scoped_lock one_request(requests_);
        {
            const std::scoped_lock lock(mutex_);
            if (absl::Status idle = check_idle(); !idle.ok()) return idle;
            if (options_.keep_last_s == 0)
                return absl::FailedPreconditionError("the daemon keeps no rolling buffer; set [recording] keep_last_s");
            if (!(seconds >= 0)) return absl::InvalidArgumentError(fmt::format("seconds is {}; give 0 or more", seconds));
            if (status_.held_seconds <= 0)
                return absl::FailedPreconditionError("the rolling buffer is empty; start the capture");
        }
        auto folder = make_folder(name, options_.codec);
        if (!folder.ok()) return folder.status();
        const std::scoped_lock lock(mutex_);
        status_.state = RecorderState::kRecording;
        status_.recording = (*folder)->info();
        recording_ = true;
        dropped_ = told_dropped_ = 0;
        first_number_ = 0;   // it has its first set
        begin_at_ = next_number_;
        begin_ = [this, made = std::make_shared<std::unique_ptr<RecordingFolder>>(*std::move(folder)), seconds] {
            writer_.begin_with_held(std::move(*made), seconds);
        };
        if (!go_on) {
            recording_ = false;
            finish_.emplace(Finish{next_number_, {}, std::promise<RecordingInfo>()});
            answer = finish_->answer->get_future();
        }
        changed_.notify_all();
        tell_({EventKind::kRecordingStarted, 0, 0, {},
               fmt::format("what was kept of the last seconds goes into recording \"{}\"", name)});
        if (go_on) return *status_.recording;
    }
    return answer.get();
}

absl::StatusOr<RecordingInfo> LiveRecorder::finish(std::string reason) {
    std::future<RecordingInfo> answer;
    {
        const std::scoped_lock one_request(requests_);
        const std::scoped_lock lock(mutex_);
        if (status_.state == RecorderState::kIdle)
            return absl::FailedPreconditionError("nothing is being recorded; `kinevox record start` begins");
        if (finish_ && finish_->answer)
            return absl::FailedPreconditionError("the recording is being finished already; wait for it");
        if (!finish_) finish_.emplace(Finish{next_number_, std::move(reason), {}});
        recording_ = false;
        status_.state = RecorderState::kFinishing;
        answer = finish_->answer.emplace().get_future();
        changed_.notify_all();
    }
    return answer.get();
}

void LiveRecorder::write_loop(const std::stop_token& stop) {
    for (;;) {
        std::deque<std::shared_ptr<EncodedSet>> done;
        std::deque<ResultOfSet> results;
        std::optional<BodyShape> body;
        bool background = false;
        std::function<void()> begin;
        std::uint64_t begin_at = 0;
        {
            std::unique_lock lock(mutex_);
            changed_.wait_for(lock, stop, finish_ || begin_ ? kFinishBeat : kWriterBeat,
                              [&] { return !done_.empty() || !results_.empty(); });
            if (stop.stop_requested()) return;
            done.swap(done_);
            results.swap(results_);
            if (std::exchange(body_changed_, false)) body = body_;
            background = std::exchange(background_changed_, false);
            const std::uint64_t next = done.empty() ? writer_.next_number() : done.back()->number + 1;
            begin_at = begin_at_;
            if (begin_ && next >= begin_at) begin = std::exchange(begin_, nullptr);
            writer_.dropped = dropped_;
        }
        for (auto& set : done) {
            // Just before the first set that came after the request: what the rolling buffer held then is what was
            // asked for, and each set that it takes from now on would push out its oldest.
            if (begin && set->number >= begin_at) std::exchange(begin, nullptr)();
            const std::size_t bytes = set->raw_bytes;
            writer_.take(std::move(set));
            const std::scoped_lock lock(mutex_);
            queued_bytes_ -= std::min(queued_bytes_, bytes);
        }
        if (begin) begin();
        if (body) writer_.set_body(*body);
        if (background) writer_.set_background(clip_.files(false));
        for (ResultOfSet& result : results) writer_.take(std::move(result));
        finish_if_done();
        tell_drops();
    }
}

void LiveRecorder::finish_if_done() {
    Finish finish;
    std::uint64_t dropped = 0;
    bool ended_by_itself = false;
    {
        const std::scoped_lock lock(mutex_);
        const RecordingWriter::Held held = writer_.held();
        status_.held_seconds = held.seconds;
        status_.held_bytes = held.bytes;
        status_.held_shortened = held.shortened;
        status_.recording = begin_ ? status_.recording : writer_.recording(dropped_);
        if (status_.state == RecorderState::kWaiting && status_.recording && status_.recording->about.frames > 0)
            status_.state = RecorderState::kRecording;
        if (!finish_ || begin_) return;
        const bool all_sets = writer_.next_number() >= finish_->upto || !lanes_;
        const bool late = Clock::now() - finish_->begun > kLongestWaitForResults;
        if (status_.recording && (!all_sets || (!writer_.has_all_results() && !late))) return;
        finish = *std::exchange(finish_, std::nullopt);
        dropped = dropped_;
        ended_by_itself = !status_.recording;
    }
    RecordingInfo info;
    if (!ended_by_itself) {
        writer_.set_background(clip_.files(true));   // learned, but not yet written
        info = writer_.end(dropped, finish.reason);
        ended(info, EventKind::kRecordingStopped);
    } else {
        const std::scoped_lock lock(mutex_);
        if (status_.last) info = *status_.last;
    }
    if (finish.answer) finish.answer->set_value(info);
    changed_.notify_all();
}

void LiveRecorder::tell_drops() {
    std::uint64_t dropped = 0;
    std::string name;
    {
        const std::scoped_lock lock(mutex_);
        if (!status_.recording || dropped_ == told_dropped_ || Clock::now() - drops_told_ < kTellDropsEvery) return;
        dropped = std::exchange(told_dropped_, dropped_);
        dropped = dropped_ - dropped;
        name = status_.recording->name;
        drops_told_ = Clock::now();
    }
    tell_({EventKind::kRecordingDrops, 0, 0, {},
           fmt::format("{} frame sets did not get into \"{}\": they came faster than they could be encoded and written; a "
                       "faster codec or fewer programs beside it help",
                       dropped, name)});
}

// On the writer's thread.
void LiveRecorder::failed(const RecordingInfo& info) { ended(info, EventKind::kRecordingFailed); }

void LiveRecorder::ended(const RecordingInfo& info, EventKind kind) {
    {
        const std::scoped_lock lock(mutex_);
        status_.state = RecorderState::kIdle;
        status_.recording.reset();
        status_.last = info;
        recording_ = false;
    }
    if (options_.keep_last_s == 0) drop_lanes();
    const std::string why = info.about.end_reason.empty() ? "" : "; " + info.about.end_reason;
    tell_({kind, 0, 0, {}, fmt::format("recording \"{}\" ended: {}{}", info.name, summary(info), why)});
}

RecorderStatus LiveRecorder::status() const {
    RecorderStatus status;
    {
        const std::scoped_lock lock(mutex_);
        status = status_;
        status.queued_bytes = queued_bytes_;
        status.held_dropped = held_dropped_;
    }
    std::error_code error;
    std::filesystem::path existing = options_.folder;
    while (!existing.empty() && !std::filesystem::exists(existing, error) && existing != existing.parent_path())
        existing = existing.parent_path();
    if (const auto space = std::filesystem::space(existing, error); !error) status.free_bytes = space.available;
    return status;
}

void LiveRecorder::close() {
    {
        const std::scoped_lock lock(mutex_);
        if (std::exchange(closed_, true)) return;
    }
    finish("the daemon was stopped").IgnoreError();   // or somebody else's stop is under way
    {
        std::unique_lock lock(mutex_);
        changed_.wait_for(lock, kLongestClose, [this] { return status_.state == RecorderState::kIdle && !finish_; });
    }
    writer_thread_ = {};
    if (finish_ && finish_->answer) finish_->answer->set_value({});
    drop_lanes();
}

}  // namespace

absl::StatusOr<std::unique_ptr<Recorder>> Recorder::create(const RecorderOptions& options,
                                                           std::function<RecordedCapture()> capture,
                                                           std::function<void(Event)> tell) {
    auto recorder = std::make_unique<LiveRecorder>(options, std::move(capture), std::move(tell));
    if (absl::Status ready = recorder->open(); !ready.ok()) return ready;
    return recorder;
}

}  // namespace kinevox
