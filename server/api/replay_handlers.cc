#include "server/api/replay_handlers.h"

#include <filesystem>

#include <fmt/format.h>

#include "server/calibration/procedure.h"
#include "server/pipeline/replay.h"

namespace kinevox {
namespace {

void fill(const ApiContext& api, v1::Replay& out) {
    const ReplayStatus status = api.replay->status();
    out.set_state(v1::REPLAY_STATE_LIVE);
    out.set_frame(-1);
    if (!status.open) return;
    out.set_session(status.session_file.string());
    if (!status.position) return out.set_state(v1::REPLAY_STATE_STOPPED);
    const ReplayPosition& position = *status.position;
    const RunState run = api.runner.state().state;
    out.set_state(!is_active(run)                            ? v1::REPLAY_STATE_STOPPED
                  : position.state == ReplayState::kPlaying ? v1::REPLAY_STATE_PLAYING
                  : position.state == ReplayState::kPaused  ? v1::REPLAY_STATE_PAUSED
                                                            : v1::REPLAY_STATE_ENDED);
    out.set_frame(position.frame);
    out.set_frames(position.frames);
    out.set_position_s(position.position_s);
    out.set_fps(position.fps);
    out.set_speed(position.speed);
    out.set_loop(position.loop);
    out.set_jumps(position.jumps);
}

}  // namespace

absl::Status check_replay(const ApiContext& api) {
    return api.replay ? absl::OkStatus() : absl::FailedPreconditionError("this daemon cannot replay");
}

absl::Status check_live(const ApiContext& api, const char* what) {
    if (!api.replay || !api.replay->status().open) return absl::OkStatus();
    return absl::FailedPreconditionError(
        fmt::format("a recording is replayed, {} the cameras; go back to them first, with kinevox replay live", what));
}

absl::Status open_replay(const ApiContext& api, const v1::OpenReplayRequest& request, v1::OpenReplayResponse& response) {
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    if (api.procedure && api.procedure->progress().open())
        return absl::FailedPreconditionError("a calibration procedure is open, which needs the cameras; cancel it first");
    const std::filesystem::path session = request.session();
    if (!session.is_absolute())
        return absl::InvalidArgumentError(fmt::format(
            "'{}' is no absolute path; the daemon reads a session by its full name on its own machine", request.session()));
    ReplayOptions options;
    options.paused = request.paused();
    options.loop = request.loop();
    if (request.speed() != 0) options.speed = request.speed();
    if (absl::Status opened = api.replay->open(session, options); !opened.ok()) return opened;
    fill(api, *response.mutable_replay());
    return absl::OkStatus();
}

absl::Status close_replay(const ApiContext& api, const v1::CloseReplayRequest& request, v1::CloseReplayResponse&) {
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    return api.replay->live();
}

absl::Status set_replay(const ApiContext& api, const v1::SetReplayRequest& request, v1::SetReplayResponse& response) {
    if (absl::Status there = check_replay(api); !there.ok()) return there;
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    ReplayChange change;
    if (request.has_speed()) change.speed = request.speed();
    if (request.has_loop()) change.loop = request.loop();
    if (request.has_frame()) change.frame = request.frame();
    if (request.has_position_s()) change.position_s = request.position_s();
    if (request.has_step()) change.step = request.step();
    if (request.has_play()) change.play = request.play();
    if (absl::Status changed = api.replay->change(change); !changed.ok()) return changed;
    fill(api, *response.mutable_replay());
    return absl::OkStatus();
}

absl::Status get_replay(const ApiContext& api, const v1::GetReplayRequest&, v1::GetReplayResponse& response) {
    if (absl::Status there = check_replay(api); !there.ok()) return there;
    fill(api, *response.mutable_replay());
    return absl::OkStatus();
}

}  // namespace kinevox
