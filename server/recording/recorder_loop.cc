#include <fmt/format.h>

#include <algorithm>

#include "server/recording/live_recorder.h"

namespace kinevox {
namespace {

constexpr std::chrono::milliseconds kMaxWaitForResults{1500}, kWriterBeat{50}, kFinishBeat{5};
constexpr std::chrono::seconds kTellDropsEvery{5};

std::string summary(const RecordingInfo& info) {
    std::string text =
        fmt::format("{} frame sets, {:.1f} s, {} MB", info.about.frames, info.seconds, info.bytes >> 20);
    if (info.about.dropped > 0) text += fmt::format(", {} dropped", info.about.dropped);
    if (info.about.lost > 0) text += fmt::format(", {} lost before", info.about.lost);
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
            // Just before the first set that came after the request: what the rolling buffer held then is
            // what was asked for, and each set that it takes from now on would push out its oldest.
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
        if (status_.state == RecorderState::kWaiting && status_.recording &&
            status_.recording->about.frames > 0)
            status_.state = RecorderState::kRecording;
        if (!finish_ || begin_) return;
        const bool all_sets = writer_.next_number() >= finish_->upto || !lanes_;
        const bool late = Clock::now() - finish_->begun > kMaxWaitForResults;
        if (status_.recording && (!all_sets || (!writer_.has_all_results() && !late))) return;
        finish = *std::exchange(finish_, std::nullopt);
        dropped = dropped_;
        ended_by_itself = !status_.recording;
    }
    RecordingInfo info;
    if (!ended_by_itself) {
        writer_.set_background(clip_.files(true));  // learned, but not yet written
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
        if (!status_.recording || dropped_ == told_dropped_ || Clock::now() - drops_told_ < kTellDropsEvery)
            return;
        dropped = dropped_ - std::exchange(told_dropped_, dropped_);
        name = status_.recording->name;
        drops_told_ = Clock::now();
    }
    tell_({EventKind::kRecordingDrops,
           0,
           0,
           {},
           fmt::format("{} frame sets did not get into \"{}\": they came faster than they could be encoded "
                       "and written; a "
                       "faster codec or fewer programs beside it help",
                       dropped, name)});
}

// On the writer's thread.
void LiveRecorder::failed(const RecordingInfo& info) {
    ended(info, EventKind::kRecordingFailed);
}

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

}  // namespace kinevox
