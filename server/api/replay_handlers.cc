#include "server/api/replay_handlers.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "server/api/recording_handlers.h"
#include "server/calibration/procedure.h"
#include "server/pipeline/replay.h"
#include "server/recording/recording_list.h"

namespace kinevox {
namespace {

constexpr std::size_t kMaxNames = 12;  // of recordings, in a message

void fill(const ApiContext& api, v1::Replay& out) {
    const ReplayStatus status = api.replay->status();
    out.set_state(v1::REPLAY_STATE_LIVE);
    out.set_frame(-1);
    if (!status.open) return;
    out.set_session(status.session_file.string());
    if (!status.position) return out.set_state(v1::REPLAY_STATE_STOPPED);
    const ReplayPosition& position = *status.position;
    const RunState run = api.runner.state().state;
    out.set_state(!is_active(run)                           ? v1::REPLAY_STATE_STOPPED
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

// An absolute path, or the name of one of the daemon's recordings.
absl::StatusOr<std::filesystem::path> session_to_open(const ApiContext& api, const std::string& session) {
    if (std::filesystem::path(session).is_absolute()) return session;
    const std::string neither =
        fmt::format("'{}' is no absolute path of a session.toml on the daemon's machine", session);
    if (!check_recording(api).ok())
        return absl::NotFoundError(neither +
                                   ", and the daemon has no folder for recordings; give such a path");
    const std::filesystem::path& folder = api.recorder->options().folder;
    if (const auto file = recording_session_file(folder, session); file.ok()) return file;
    std::vector<std::string> names;
    for (const RecordingInfo& info : list_recordings(folder)) names.push_back(info.name);
    const std::size_t left_out = names.size() - std::min(names.size(), kMaxNames);
    names.erase(names.begin(), names.begin() + static_cast<std::ptrdiff_t>(left_out));
    if (left_out > 0) names.insert(names.begin(), fmt::format("{} older ones", left_out));
    return absl::NotFoundError(
        fmt::format("{}, and no recording in {}, which has {}", neither, folder.string(),
                    names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "))));
}

}  // namespace

absl::Status check_replay(const ApiContext& api) {
    return api.replay ? absl::OkStatus() : absl::FailedPreconditionError("this daemon cannot replay");
}

absl::Status check_live(const ApiContext& api, const char* why) {
    if (!api.replay || !api.replay->status().open) return absl::OkStatus();
    return absl::FailedPreconditionError(fmt::format(
        "a recording is replayed, {} the cameras; go back to them first, with kinevox replay live", why));
}

absl::Status open_replay(const ApiContext& api, const v1::OpenReplayRequest& request,
                         v1::OpenReplayResponse& response) {
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    if (api.procedure && api.procedure->progress().open())
        return absl::FailedPreconditionError(
            "a calibration procedure is open, which needs the cameras; cancel it first");
    if (api.recorder)
        if (const RecorderStatus now = api.recorder->status(); now.state != RecorderState::kIdle)
            return absl::FailedPreconditionError(
                fmt::format("\"{}\" is being recorded, which needs the cameras; stop that first, with "
                            "kinevox record stop",
                            now.recording ? now.recording->name : "another recording"));
    const auto session = session_to_open(api, request.session());
    if (!session.ok()) return session.status();
    ReplayOptions options;
    options.paused = request.paused();
    options.loop = request.loop();
    if (request.speed() != 0) options.speed = request.speed();
    if (absl::Status opened = api.replay->open(*session, options); !opened.ok()) return opened;
    fill(api, *response.mutable_replay());
    return absl::OkStatus();
}

absl::Status close_replay(const ApiContext& api, const v1::CloseReplayRequest& request,
                          v1::CloseReplayResponse&) {
    if (const auto control = api.lease.use(request.lease_id()); !control.ok()) return control.status();
    return api.replay->live();
}

absl::Status set_replay(const ApiContext& api, const v1::SetReplayRequest& request,
                        v1::SetReplayResponse& response) {
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
