// The recorder's implementation: the capture's and the calls' threads (recorder.cc), the writer's thread
// (recorder_loop.cc).
#pragma once

#include <chrono>
#include <condition_variable>
#include <deque>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <utility>

#include "common/utc_clock.h"
#include "server/pose/body_shape.h"
#include "server/recording/encoding_lanes.h"
#include "server/recording/recorder.h"
#include "server/recording/recording_folder.h"
#include "server/recording/recording_writer.h"

namespace kinevox {

class LiveRecorder final : public Recorder {
  public:
    LiveRecorder(const RecorderOptions& options, std::function<RecordedCapture()> capture,
                 std::function<void(Event)> publish_event)
        : options_(options),
          capture_(std::move(capture)),
          publish_event_(std::move(publish_event)),
          writer_(options, [this](const RecordingInfo& info) { failed(info); }),
          clip_(options.folder, [this] {
              const std::scoped_lock lock(mutex_);
              background_changed_ = true;
          }) {
        writer_thread_ = std::jthread([this](const std::stop_token& stop) { write_loop(stop); });
    }
    ~LiveRecorder() override { close(); }
    absl::Status open() {
        return options_.max_buffer_s > 0 ? make_lanes(capture_(), options_.codec) : absl::OkStatus();
    }

    void offer(const FrameSet& frame_set) override;
    void observe(const FrameResult& result, const BodyOf& body_of) override;
    void background_learned(BackgroundImages images) override {
        const RecordedCapture capture = capture_();
        clip_.store(capture.cameras, capture.fps, std::move(images));
    }
    void capture_ended() override;
    absl::StatusOr<std::string> start(const std::string& name, std::optional<VideoCodec> codec) override;
    absl::StatusOr<RecordingInfo> stop() override { return finish({}); }
    absl::StatusOr<RecordingInfo> save_buffer(const std::string& name, double duration_s,
                                              bool continue_recording) override;
    RecorderStatus status() const override;
    const RecorderOptions& options() const override { return options_; }
    void close() override;

  private:
    using Clock = std::chrono::steady_clock;
    struct Finish {
        std::uint64_t end_number = 0;  // number of the first set after it
        std::string reason;
        std::optional<std::promise<RecordingInfo>> answer;
        Clock::time_point begun = Clock::now();
    };

    absl::Status check_idle() const;  // mutex held
    std::shared_ptr<const BodyShape> shared_body(std::uint32_t subject_id, const BodyShape& body);
    absl::StatusOr<std::unique_ptr<RecordingFolder>> make_folder(const std::string& name, VideoCodec codec);
    absl::Status make_lanes(const RecordedCapture& capture, VideoCodec codec);
    void drop_lanes();
    absl::StatusOr<RecordingInfo> finish(std::string reason);
    bool taking() const {
        return lanes_ != nullptr && (options_.max_buffer_s > 0 || recording_);
    }  // mutex held
    void write_loop(const std::stop_token& stop);
    void finish_if_done();
    void report_drops();
    void failed(const RecordingInfo& info);
    void ended(const RecordingInfo& info, EventKind kind);

    const RecorderOptions options_;
    const std::function<RecordedCapture()> capture_;
    const std::function<void(Event)> publish_event_;
    std::mutex requests_;  // serialises start, stop and save_buffer

    mutable std::mutex mutex_;  // guards the members down to the blank line
    std::condition_variable_any changed_;
    std::unique_ptr<EncodingLanes> lanes_;
    VideoCodec lanes_codec_ = VideoCodec::kUtVideo;
    bool closed_ = false, recording_ = false, key_wanted_ = true;
    std::uint64_t key_distance_ = 1;  // frame sets
    std::uint64_t first_number_ = 0;  // of the current recording
    std::uint64_t run_ = 0, next_number_ = 0, dropped_ = 0, buffer_dropped_ = 0, reported_dropped_ = 0;
    std::size_t queued_bytes_ = 0;
    std::optional<std::int64_t> utc_minus_capture_ns_;  // of this run, as of the latest recording's start
    ClockSteps clock_steps_;                            // since then
    std::deque<std::shared_ptr<EncodedSet>> done_;
    std::deque<ResultOfSet> results_;
    std::optional<BodyShape> body_;                                     // of the first subject
    std::map<std::uint32_t, std::shared_ptr<const BodyShape>> bodies_;  // of each of several, while tracked
    bool body_changed_ = false, background_changed_ = false;
    std::function<void()> begin_;  // called by the writer's thread once the sets before it are done
    std::uint64_t begin_at_ = 0;
    std::optional<Finish> finish_;
    RecorderStatus status_;

    RecordingWriter writer_;  // the writer thread's own
    Clock::time_point drops_reported_{};
    BackgroundClip clip_;  // notifies the members above
    std::jthread writer_thread_;
};

}  // namespace kinevox
