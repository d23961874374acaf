#include "server/pipeline/replay.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

namespace kinevox {

Replay::Replay(Runner& runner, MakePipeline make_pipeline, OnChange on_change)
    : runner_(runner), make_pipeline_(std::move(make_pipeline)), on_change_(std::move(on_change)) {}

absl::Status Replay::stop_running(bool& ran) {
    const absl::Status stopped = runner_.stop();
    ran = stopped.ok();
    return absl::IsFailedPrecondition(stopped) ? absl::OkStatus() : stopped;  // nothing ran
}

absl::Status Replay::open(const std::filesystem::path& session_file, const ReplayOptions& options) {
    // Everything that can be wrong with the session, before anything is stopped.
    auto source = ReplaySource::open(session_file, options);
    if (!source.ok()) return source.status();
    CaptureSetup setup;
    setup.fps = (*source)->fps();
    setup.own_cameras = setup.cameras = (*source)->cameras();
    auto pipeline = make_pipeline_(setup.cameras, setup.fps);
    if (!pipeline.ok()) return pipeline.status();
    setup.pipeline = *std::move(pipeline);
    setup.source = *source;
    const auto slot = std::make_shared<SourceSlot>();
    slot->source = *source;
    setup.reopen = [slot, session_file, options]() -> absl::StatusOr<std::shared_ptr<FrameSource>> {
        auto opened = ReplaySource::open(session_file, options);
        if (!opened.ok()) return opened.status();
        const std::scoped_lock lock(slot->mutex);
        slot->source = *opened;
        return std::shared_ptr<FrameSource>(*opened);
    };

    bool ran = false;
    if (absl::Status stopped = stop_running(ran); !stopped.ok()) return stopped;
    auto before = runner_.swap_setup(std::move(setup));
    if (!before.ok()) return before.status();
    if (const absl::Status started = runner_.start(); !started.ok()) {
        // The previous setup: the cameras, or the session replayed before.
        if (const auto back = runner_.swap_setup(*std::move(before)); !back.ok()) return back.status();
        if (ran) runner_.start().IgnoreError();  // reports its own error
        return started;
    }
    if (!live_) live_ = *std::move(before), live_ran_ = ran;
    {
        const std::scoped_lock lock(mutex_);
        slot_ = slot;
        session_file_ = session_file;
    }
    on_change_(EventKind::kReplayOpened, fmt::format("replaying {}", session_file.string()));
    return absl::OkStatus();
}

absl::Status Replay::close() {
    if (!live_) return absl::FailedPreconditionError("no replay is open; the cameras are captured");
    bool ran = false;
    if (absl::Status stopped = stop_running(ran); !stopped.ok()) return stopped;
    if (const auto replayed = runner_.swap_setup(*std::exchange(live_, std::nullopt)); !replayed.ok())
        return replayed.status();
    {
        const std::scoped_lock lock(mutex_);
        slot_.reset();
        session_file_.clear();
    }
    on_change_(EventKind::kReplayClosed, "replay closed; capturing the cameras");
    return live_ran_ ? runner_.start() : absl::OkStatus();
}

std::shared_ptr<ReplaySource> Replay::source() const {
    std::shared_ptr<SourceSlot> slot;
    {
        const std::scoped_lock lock(mutex_);
        slot = slot_;
    }
    if (!slot) return nullptr;
    const std::scoped_lock lock(slot->mutex);
    return slot->source;
}

absl::Status Replay::change(const ReplayChange& change) {
    const auto replayed = source();
    if (!replayed)
        return absl::FailedPreconditionError(
            "no replay is open; open a recording first (kinevox replay open)");
    if (change.position_s && !std::isfinite(*change.position_s))
        return absl::InvalidArgumentError(
            "the position is not a number; give seconds from the start of the recording");
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
        out.open = slot_ != nullptr;
        out.session_file = session_file_;
    }
    if (const auto replayed = source()) out.position = replayed->position();
    return out;
}

}  // namespace kinevox
