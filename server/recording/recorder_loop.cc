#include <fmt/format.h>

#include <algorithm>

#include "server/recording/live_recorder.h"

namespace kinevox {
namespace {

constexpr std::chrono::milliseconds kMaxWaitForResults{1500}, kWriterInterval{50}, kFinishInterval{5};
constexpr std::chrono::seconds kReportDropsInterval{5};

std::string summary(const RecordingInfo& info) {
    std::string text = fmt::format("{} frame sets, {:.1f} s, {} MB", info.about.frame_sets, info.duration_s,
                                   info.size_bytes >> 20);
    if (info.about.dropped_frame_sets > 0) text += fmt::format(", {} dropped", info.about.dropped_frame_sets);
    if (info.about.lost_frame_sets > 0)
        text += fmt::format(", {} lost before the recorder", info.about.lost_frame_sets);
    return text;
}

}  // namespace

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
            changed_.wait_for(lock, stop, finish_ || begin_ ? kFinishInterval : kWriterInterval,
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
            // Just before the first set after the request: the buffer then holds exactly what was requested,
            // and each further set would push out its oldest.
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
        report_drops();
    }
}

void LiveRecorder::finish_if_done() {
    Finish finish;
    std::uint64_t dropped = 0;
    bool already_ended = false;
    {
        const std::scoped_lock lock(mutex_);
        const RecordingWriter::Buffered buffered = writer_.buffered();
        status_.buffered_s = buffered.duration_s;
        status_.buffered_bytes = buffered.bytes;
        status_.buffer_limited_by_memory = buffered.limited_by_memory;
        status_.current = begin_ ? status_.current : writer_.recording(dropped_);
        if (status_.state == RecorderState::kWaiting && status_.current &&
            status_.current->about.frame_sets > 0)
            status_.state = RecorderState::kRecording;
        if (!finish_ || begin_) return;
        const bool all_sets = writer_.next_number() >= finish_->end_number || !lanes_;
        const bool late = Clock::now() - finish_->begun > kMaxWaitForResults;
        if (status_.current && (!all_sets || (!writer_.has_all_results() && !late))) return;
        finish = *std::exchange(finish_, std::nullopt);
        dropped = dropped_;
        already_ended = !status_.current;
    }
    RecordingInfo info;
    if (!already_ended) {
        writer_.set_background(clip_.files(true));  // if learned, but not yet written
        info = writer_.end(dropped, finish.reason);
        ended(info, EventKind::kRecordingStopped);
    } else {
        const std::scoped_lock lock(mutex_);
        if (status_.latest) info = *status_.latest;
    }
    if (finish.answer) finish.answer->set_value(info);
    changed_.notify_all();
}

void LiveRecorder::report_drops() {
    std::uint64_t dropped = 0;
    std::string name;
    {
        const std::scoped_lock lock(mutex_);
        if (!status_.current || dropped_ == reported_dropped_ ||
            Clock::now() - drops_reported_ < kReportDropsInterval)
            return;
        dropped = dropped_ - std::exchange(reported_dropped_, dropped_);
        name = status_.current->name;
        drops_reported_ = Clock::now();
    }
    publish_event_(
        {EventKind::kRecordingFramesDropped,
         0,
         0,
         {},
         fmt::format("recording \"{}\" dropped {} frame sets: encoding or the disk is too slow; use a faster "
                     "codec or disk, or stop other programs",
                     name, dropped)});
}

// On the writer's thread.
void LiveRecorder::failed(const RecordingInfo& info) {
    ended(info, EventKind::kRecordingFailed);
}

void LiveRecorder::ended(const RecordingInfo& info, EventKind kind) {
    {
        const std::scoped_lock lock(mutex_);
        status_.state = RecorderState::kIdle;
        status_.current.reset();
        status_.latest = info;
        recording_ = false;
    }
    if (options_.max_buffer_s == 0) drop_lanes();
    const std::string why = info.about.end_reason.empty() ? "" : "; " + info.about.end_reason;
    publish_event_(
        {kind, 0, 0, {}, fmt::format("recording \"{}\" ended: {}{}", info.name, summary(info), why)});
}

}  // namespace kinevox
