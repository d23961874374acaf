#include "server/recording/recorder.h"

#include <fmt/format.h>

#include <algorithm>
#include <ctime>
#include <system_error>

#include "common/utc_clock.h"
#include "server/recording/live_recorder.h"

namespace kinevox {
namespace {

constexpr std::size_t kMaxQueuedResults = 256;
constexpr std::chrono::seconds kMaxClose{5};

std::string name_by_time() {
    const std::time_t now = std::time(nullptr);
    std::tm local{};
    localtime_r(&now, &local);
    char text[64];
    std::strftime(text, sizeof text, "%Y-%m-%d_%H-%M-%S", &local);
    return text;
}

}  // namespace

void LiveRecorder::offer(const FrameSet& frame_set) {
    std::size_t bytes = 0;
    for (const Image& image : frame_set.images)
        bytes +=
            static_cast<std::size_t>(image.width) * static_cast<std::size_t>(image.height * image.channels);
    const std::scoped_lock lock(mutex_);
    if (closed_ || !taking()) return;
    if (!utc_minus_capture_ns_) {
        utc_minus_capture_ns_ = utc_minus_capture_ns(frame_set.capture_time_ns);
        clock_steps_ = {};
    }
    if (queued_bytes_ > 0 && queued_bytes_ + bytes > options_.max_queue_bytes) {
        ++(recording_ ? dropped_ : buffer_dropped_);
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
    lanes_->put(std::move(set), frame_set.images);
}

// With the mutex held. Results that wait in the rolling buffer share a body that has not changed.
std::shared_ptr<const BodyShape> LiveRecorder::shared_body(std::uint32_t subject_id, const BodyShape& body) {
    std::shared_ptr<const BodyShape>& known = bodies_[subject_id];
    if (!known || *known != body) known = std::make_shared<const BodyShape>(body);
    return known;
}

void LiveRecorder::observe(const FrameResult& result, const BodyOf& body_of) {
    const std::uint32_t first_id = result.subjects.empty() ? 0 : result.subjects.front().track.subject_id;
    const std::scoped_lock lock(mutex_);
    if (const BodyShape* const body = body_of(first_id); body && body_ != *body) {
        body_ = *body;
        body_changed_ = true;
    }
    // The pipeline lags some frame sets: the last results arrive after the last frame set was taken.
    if (!finish_ && (closed_ || !taking())) return;
    ResultOfSet& taken = results_.emplace_back();
    taken.run = run_;
    taken.sequence = result.sequence;
    for (const SubjectResult& subject : result.subjects) {
        ResultOfSet::Subject& one = taken.subjects.emplace_back();
        one.id = subject.track.subject_id;
        one.name = subject.track.name;
        if (options_.save_poses) one.pose = subject.pose;
        if (options_.save_volumes) one.volume = subject.volume;
        if (const BodyShape* const body = options_.several_subjects ? body_of(one.id) : nullptr)
            one.body = shared_body(one.id, *body);
    }
    std::erase_if(bodies_, [&](const auto& known) {
        return std::ranges::find(taken.subjects, known.first, &ResultOfSet::Subject::id) ==
               taken.subjects.end();
    });
    if (results_.size() > kMaxQueuedResults) results_.pop_front();
    changed_.notify_all();
}

void LiveRecorder::capture_ended() {
    const std::scoped_lock lock(mutex_);
    ++run_;
    utc_minus_capture_ns_.reset();
    buffer_dropped_ = 0;
    key_wanted_ = true;
    if (recording_ && !finish_ && next_number_ > first_number_) {  // else it waits for the next run
        recording_ = false;
        finish_.emplace(Finish{next_number_, "the capture ended", {}});
    }
    changed_.notify_all();
}

absl::Status LiveRecorder::check_idle() const {
    if (closed_) return absl::UnavailableError("the daemon is stopping");
    if (status_.state == RecorderState::kIdle && !finish_ && !begin_) return absl::OkStatus();
    return absl::FailedPreconditionError(
        fmt::format("\"{}\" is being recorded; stop that first",
                    status_.current ? status_.current->name : "another recording"));
}

absl::StatusOr<std::unique_ptr<RecordingFolder>> LiveRecorder::make_folder(const std::string& name,
                                                                           VideoCodec codec) {
    if (options_.folder.empty())
        return absl::FailedPreconditionError("no recording folder is configured; set [recording] folder");
    if (const std::string problem = recording_name_problem(name); !problem.empty())
        return absl::InvalidArgumentError(problem);
    std::error_code error;
    std::filesystem::create_directories(options_.folder, error);
    if (const auto space = std::filesystem::space(options_.folder, error);
        !error && space.available < options_.min_free_bytes)
        return absl::ResourceExhaustedError(
            fmt::format("{} MB are free on the disk of {}, min_free_disk_mb is {}; free some space",
                        space.available >> 20, options_.folder.string(), options_.min_free_bytes >> 20));
    const RecordedCapture capture = capture_();
    RecordingPlan plan;
    plan.folder = options_.folder / name;
    plan.fps = capture.fps;
    plan.codec = codec;
    plan.cameras = capture.cameras;
    // It is still being written a second or two after learning. A recording killed before it arrives would be
    // useless, so the start waits for it.
    plan.background = clip_.files(true);
    plan.calibration_id = capture.calibration_id;
    plan.certificate_json = capture.certificate_json;
    plan.calibration_file = capture.calibration_file;
    plan.save_poses = options_.save_poses;
    plan.save_volumes = options_.save_volumes;
    plan.several_subjects = options_.several_subjects;
    if (absl::Status ready = make_lanes(capture, codec); !ready.ok()) return ready;
    {
        const std::scoped_lock lock(mutex_);
        plan.body = body_;
        plan.formats = lanes_->formats();
    }
    auto folder = RecordingFolder::create(plan);
    if (!folder.ok() && options_.max_buffer_s == 0) drop_lanes();
    return folder;
}

absl::Status LiveRecorder::make_lanes(const RecordedCapture& capture, VideoCodec codec) {
    {
        const std::scoped_lock lock(mutex_);
        if (lanes_ && lanes_codec_ == codec) return absl::OkStatus();
        if (lanes_ && options_.max_buffer_s > 0)
            return absl::FailedPreconditionError(
                fmt::format("the rolling buffer uses codec {}; record with that, or set max_buffer_s = 0",
                            name_of(lanes_codec_)));
    }
    auto lanes =
        EncodingLanes::create(capture.cameras, capture.fps, codec, [this](std::shared_ptr<EncodedSet> set) {
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

// Their threads end outside the lock, which they need.
void LiveRecorder::drop_lanes() {
    std::unique_ptr<EncodingLanes> dropped;
    const std::scoped_lock lock(mutex_);
    dropped.swap(lanes_);
    queued_bytes_ = 0;
}

absl::StatusOr<std::string> LiveRecorder::start(const std::string& requested,
                                                std::optional<VideoCodec> codec) {
    const std::scoped_lock one_request(requests_);
    {
        const std::scoped_lock lock(mutex_);
        if (absl::Status idle = check_idle(); !idle.ok()) return idle;
    }
    const std::string name = requested.empty() ? name_by_time() : requested;
    auto folder = make_folder(name, codec.value_or(options_.codec));
    if (!folder.ok()) return folder.status();
    const std::scoped_lock lock(mutex_);
    status_.state = RecorderState::kWaiting;
    status_.current = (*folder)->info();
    recording_ = key_wanted_ = true;
    if (utc_minus_capture_ns_)
        *utc_minus_capture_ns_ += clock_steps_.step_ns();  // no clock step within a recording
    dropped_ = reported_dropped_ = 0;
    first_number_ = next_number_;
    begin_at_ = 0;
    begin_ = [this, made = std::make_shared<std::unique_ptr<RecordingFolder>>(*std::move(folder)),
              first = next_number_] { writer_.begin(std::move(*made), first); };
    changed_.notify_all();
    publish_event_({EventKind::kRecordingStarted, 0, 0, {}, fmt::format("recording \"{}\" started", name)});
    return name;
}

absl::StatusOr<RecordingInfo> LiveRecorder::save_buffer(const std::string& requested, double duration_s,
                                                        bool continue_recording) {
    const std::string name = requested.empty() ? name_by_time() : requested;
    std::future<RecordingInfo> answer;
    {
        const std::scoped_lock one_request(requests_);
        {
            const std::scoped_lock lock(mutex_);
            if (absl::Status idle = check_idle(); !idle.ok()) return idle;
            if (options_.max_buffer_s == 0)
                return absl::FailedPreconditionError(
                    "there is no rolling buffer; set [recording] max_buffer_s");
            if (!(duration_s >= 0))
                return absl::InvalidArgumentError(
                    fmt::format("duration is {} s, expected 0 or more", duration_s));
            if (status_.buffered_s <= 0)
                return absl::FailedPreconditionError("the rolling buffer is empty; start the capture");
        }
        auto folder = make_folder(name, options_.codec);
        if (!folder.ok()) return folder.status();
        const std::scoped_lock lock(mutex_);
        status_.state = RecorderState::kRecording;
        status_.current = (*folder)->info();
        recording_ = true;
        dropped_ = reported_dropped_ = 0;
        first_number_ = 0;  // its first set is in the buffer
        begin_at_ = next_number_;
        begin_ = [this, made = std::make_shared<std::unique_ptr<RecordingFolder>>(*std::move(folder)),
                  duration_s] { writer_.begin_with_buffer(std::move(*made), duration_s); };
        if (!continue_recording) {
            recording_ = false;
            finish_.emplace(Finish{next_number_, {}, std::promise<RecordingInfo>()});
            answer = finish_->answer->get_future();
        }
        changed_.notify_all();
        publish_event_(
            {EventKind::kRecordingStarted, 0, 0, {}, fmt::format("buffer saved to recording \"{}\"", name)});
        if (continue_recording) return *status_.current;
    }
    return answer.get();
}

absl::StatusOr<RecordingInfo> LiveRecorder::finish(std::string reason) {
    std::future<RecordingInfo> answer;
    {
        const std::scoped_lock one_request(requests_);
        const std::scoped_lock lock(mutex_);
        if (status_.state == RecorderState::kIdle)
            return absl::FailedPreconditionError(
                "no recording is in progress; start one with `kinevox record start`");
        if (finish_ && finish_->answer)
            return absl::FailedPreconditionError("the recording is already being finished; wait for it");
        if (!finish_) finish_.emplace(Finish{next_number_, std::move(reason), {}});
        recording_ = false;
        status_.state = RecorderState::kFinishing;
        answer = finish_->answer.emplace().get_future();
        changed_.notify_all();
    }
    return answer.get();
}

RecorderStatus LiveRecorder::status() const {
    RecorderStatus status;
    {
        const std::scoped_lock lock(mutex_);
        status = status_;
        status.queued_bytes = queued_bytes_;
        status.buffer_dropped_frame_sets = buffer_dropped_;
    }
    std::error_code error;
    std::filesystem::path existing = options_.folder;
    while (!existing.empty() && !std::filesystem::exists(existing, error) &&
           existing != existing.parent_path())
        existing = existing.parent_path();
    if (const auto space = std::filesystem::space(existing, error); !error)
        status.free_bytes = space.available;
    return status;
}

void LiveRecorder::close() {
    {
        const std::scoped_lock lock(mutex_);
        if (std::exchange(closed_, true)) return;
    }
    finish("the daemon was stopped").IgnoreError();  // or another stop is in progress
    {
        std::unique_lock lock(mutex_);
        changed_.wait_for(lock, kMaxClose,
                          [this] { return status_.state == RecorderState::kIdle && !finish_; });
    }
    writer_thread_ = {};
    if (finish_ && finish_->answer) finish_->answer->set_value({});
    drop_lanes();
}

absl::StatusOr<std::unique_ptr<Recorder>> Recorder::create(const RecorderOptions& options,
                                                           std::function<RecordedCapture()> capture,
                                                           std::function<void(Event)> publish_event) {
    auto recorder = std::make_unique<LiveRecorder>(options, std::move(capture), std::move(publish_event));
    if (absl::Status ready = recorder->open(); !ready.ok()) return ready;
    return recorder;
}

}  // namespace kinevox
