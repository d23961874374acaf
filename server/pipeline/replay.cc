#include "server/pipeline/replay.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace kinevox {

Replay::Replay(Runner& runner, MakePipeline make_pipeline, std::function<void(std::string)> tell)
    : runner_(runner), make_pipeline_(std::move(make_pipeline)), tell_(std::move(tell)) {}

absl::Status Replay::stop_running(bool& ran) {
    const absl::Status stopped = runner_.stop();
    ran = stopped.ok();
    return absl::IsFailedPrecondition(stopped) ? absl::OkStatus() : stopped;  // nothing ran
}

absl::Status Replay::open(const std::filesystem::path& session_file, const ReplayOptions& options) {
    // All that can be wrong with the recording, before anything is stopped.
    auto source = ReplaySource::open(session_file, options);
    if (!source.ok()) return source.status();
    Feed feed;
    feed.fps = (*source)->fps();
    feed.own_cameras = feed.cameras = (*source)->cameras();
    auto pipeline = make_pipeline_(feed.cameras, feed.fps);
    if (!pipeline.ok()) return pipeline.status();
    feed.pipeline = *std::move(pipeline);
    feed.source = *source;
    const auto shown = std::make_shared<Shown>();
    shown->source = *source;
    feed.reopen = [shown, session_file, options]() -> absl::StatusOr<std::shared_ptr<FrameSource>> {
        auto opened = ReplaySource::open(session_file, options);
        if (!opened.ok()) return opened.status();
        const std::scoped_lock lock(shown->mutex);
        shown->source = *opened;
        return std::shared_ptr<FrameSource>(*opened);
    };

    bool ran = false;
    if (absl::Status stopped = stop_running(ran); !stopped.ok()) return stopped;
    auto before = runner_.exchange(std::move(feed));
    if (!before.ok()) return before.status();
    if (const absl::Status started = runner_.start(); !started.ok()) {
        // As before: the cameras, or the recording that was shown.
        if (const auto back = runner_.exchange(*std::move(before)); !back.ok()) return back.status();
        if (ran) runner_.start().IgnoreError();  // its own event says what is wrong
        return started;
    }
    if (!live_) live_ = *std::move(before), live_ran_ = ran;
    {
        const std::scoped_lock lock(mutex_);
        shown_ = shown;
        session_file_ = session_file;
    }
    tell_(fmt::format("replaying {}", session_file.string()));
    return absl::OkStatus();
}

absl::Status Replay::live() {
    if (!live_) return absl::FailedPreconditionError("nothing is replayed; the capture sees its cameras");
    bool ran = false;
    if (absl::Status stopped = stop_running(ran); !stopped.ok()) return stopped;
    if (const auto replayed = runner_.exchange(*std::exchange(live_, std::nullopt)); !replayed.ok())
        return replayed.status();
    {
        const std::scoped_lock lock(mutex_);
        shown_.reset();
        session_file_.clear();
    }
    tell_("the cameras are seen again");
    return live_ran_ ? runner_.start() : absl::OkStatus();
}

std::shared_ptr<ReplaySource> Replay::source() const {
    std::shared_ptr<Shown> shown;
    {
        const std::scoped_lock lock(mutex_);
        shown = shown_;
    }
    if (!shown) return nullptr;
    const std::scoped_lock lock(shown->mutex);
    return shown->source;
}

absl::Status Replay::change(const ReplayChange& change) {
    const auto replayed = source();
    if (!replayed)
        return absl::FailedPreconditionError(
            "nothing is replayed; open a recording first, with kinevox replay open");
    if (change.position_s && !std::isfinite(*change.position_s))
        return absl::InvalidArgumentError(
            "the position is not a number; give seconds from the recording's begin");
    if (change.speed)
        if (absl::Status set = replayed->set_speed(*change.speed); !set.ok()) return set;
    if (change.loop) replayed->set_loop(*change.loop);
    std::optional<std::int64_t> frame = change.frame;
    if (!frame && change.position_s) frame = replayed->frame_at(*change.position_s);
    if (frame)
        if (absl::Status sought = replayed->seek(*frame); !sought.ok()) return sought;
    if (change.step) replayed->step(*change.step);
    if (change.play) *change.play ? replayed->play() : replayed->pause();
    return absl::OkStatus();
}

ReplayStatus Replay::status() const {
    ReplayStatus out;
    {
        const std::scoped_lock lock(mutex_);
        out.open = shown_ != nullptr;
        out.session_file = session_file_;
    }
    if (const auto replayed = source()) out.position = replayed->position();
    return out;
}

}  // namespace kinevox
