#include "server/api/replay_service.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <filesystem>
#include <string>
#include <vector>

#include "server/api/call.h"
#include "server/api/recording_service.h"
#include "server/calibration/procedure/procedure.h"
#include "server/cameras/session_files.h"
#include "server/pipeline/replay.h"
#include "server/recording/recording_list.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxNames = 12;  // of recordings, in a message

void fill(const ApiContext& api, v1::Replay& out) {
    const ReplayStatus status = api.replay->status();
    out.set_state(v1::REPLAY_STATE_LIVE);
    if (!status.open) return;
    out.set_session_path(status.session_file.string());
    if (!status.position) return out.set_state(v1::REPLAY_STATE_STOPPED);
    const ReplayPosition& position = *status.position;
    const RunState run = api.runner.state().state;
    out.set_state(!is_active(run)                           ? v1::REPLAY_STATE_STOPPED
                  : position.state == ReplayState::kPlaying ? v1::REPLAY_STATE_PLAYING
                  : position.state == ReplayState::kPaused  ? v1::REPLAY_STATE_PAUSED
                                                            : v1::REPLAY_STATE_ENDED);
    if (position.frame >= 0) out.set_frame(position.frame);
    out.set_frame_count(position.frame_count);
    out.set_position_s(position.position_s);
    out.set_nominal_fps(position.nominal_fps);
    out.set_speed(position.speed);
    out.set_loop(position.loop);
    out.set_discontinuity_count(position.discontinuity_count);
}

absl::StatusOr<fs::path> recording_to_open(const ApiContext& api, const std::string& name) {
    if (absl::Status missing = check_recording(api); !missing.ok()) return missing;
    const fs::path& folder = api.recorder->options().folder;
    auto file = recording_session_file(folder, name);
    if (file.ok() || !absl::IsNotFound(file.status())) return file;
    std::vector<std::string> names;
    for (const RecordingInfo& info : list_recordings(folder)) names.push_back(info.name);
    const std::size_t omitted = names.size() - std::min(names.size(), kMaxNames);
    names.erase(names.begin(), names.begin() + static_cast<std::ptrdiff_t>(omitted));
    if (omitted > 0) names.insert(names.begin(), fmt::format("{} older ones", omitted));
    return absl::NotFoundError(
        fmt::format("there is no recording '{}' in {}; recordings: {}", name, folder.string(),
                    names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "))));
}

// Whether `file` is in `folder` or below it, following symbolic links.
bool is_below(const fs::path& file, const fs::path& folder) {
    std::error_code error;
    const fs::path real_folder = fs::weakly_canonical(folder, error);
    if (error || real_folder.empty()) return false;
    const fs::path real_file = fs::weakly_canonical(file, error);
    if (error) return false;
    const auto [folder_end, file_end] = std::ranges::mismatch(real_folder, real_file);
    return folder_end == real_folder.end() || folder_end->empty();
}

// Clients must not read arbitrary files of the daemon's machine.
absl::StatusOr<fs::path> session_to_open(const ApiContext& api, const fs::path& session) {
    if (!session.is_absolute())
        return absl::InvalidArgumentError(fmt::format(
            "session_path '{}' is relative; use an absolute path on the daemon's machine, or recording_name",
            session.string()));
    std::vector<fs::path> folders = api.replay_folders;
    if (check_recording(api).ok()) folders.push_back(api.recorder->options().folder);
    if (std::ranges::any_of(folders, [&](const fs::path& folder) { return is_below(session, folder); }))
        return session;
    std::vector<std::string> names;
    for (const fs::path& folder : folders) names.push_back(folder.string());
    return absl::PermissionDeniedError(fmt::format(
        "{} is outside the folders for replay ({}); add its folder to [replay] folders in the daemon's "
        "configuration",
        session.string(), names.empty() ? "none" : fmt::format("{}", fmt::join(names, ", "))));
}

absl::StatusOr<fs::path> source_to_open(const ApiContext& api, const v1::OpenReplayRequest& request) {
    switch (request.source_case()) {
        case v1::OpenReplayRequest::kRecordingName:
            return recording_to_open(api, request.recording_name());
        case v1::OpenReplayRequest::kSessionPath:
            return session_to_open(api, request.session_path());
        case v1::OpenReplayRequest::SOURCE_NOT_SET:
            break;
    }
    return absl::InvalidArgumentError("the request names no recording; set recording_name or session_path");
}

absl::Status check_cameras_free(const ApiContext& api) {
    if (api.calibration.procedure && api.calibration.procedure->progress().open())
        return absl::FailedPreconditionError(
            "a calibration procedure is open and requires the cameras; cancel it first");
    if (!api.recorder) return absl::OkStatus();
    const RecorderStatus recorder = api.recorder->status();
    if (recorder.state == RecorderState::kIdle) return absl::OkStatus();
    return absl::FailedPreconditionError(
        fmt::format("\"{}\" is being recorded from the cameras; stop it first with kinevox record stop",
                    recorder.current ? recorder.current->name : "another recording"));
}

}  // namespace

absl::Status check_replay(const ApiContext& api) {
    return api.replay ? absl::OkStatus()
                      : absl::FailedPreconditionError("this daemon does not support replay");
}

absl::Status check_live(const ApiContext& api, const char* what) {
    if (!api.replay || !api.replay->status().open) return absl::OkStatus();
    return absl::FailedPreconditionError(fmt::format(
        "{} the cameras, but a recording is replayed; return to the cameras first with kinevox replay close",
        what));
}

absl::Status open_replay(const ApiContext& api, const v1::OpenReplayRequest& request,
                         v1::OpenReplayResponse& response) {
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    if (absl::Status free = check_cameras_free(api); !free.ok()) return free;
    const auto session = source_to_open(api, request);
    if (!session.ok()) return session.status();
    if (absl::Status intact = check_intact(*session); !intact.ok()) return intact;
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
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    return api.replay->close();
}

absl::Status update_replay(const ApiContext& api, const v1::UpdateReplayRequest& request,
                           v1::UpdateReplayResponse& response) {
    if (absl::Status there = check_replay(api); !there.ok()) return there;
    if (absl::Status control = use_control(api, request.lease_id()); !control.ok()) return control;
    ReplayChange change;
    if (request.has_speed()) change.speed = request.speed();
    if (request.has_loop()) change.loop = request.loop();
    if (request.has_frame()) change.frame = request.frame();
    if (request.has_position_s()) change.position_s = request.position_s();
    if (request.has_step_frames()) change.step = request.step_frames();
    if (request.has_playing()) change.play = request.playing();
    if (absl::Status changed = api.replay->change(change); !changed.ok()) return changed;
    fill(api, *response.mutable_replay());
    return absl::OkStatus();
}

absl::Status get_replay(const ApiContext& api, const v1::GetReplayRequest&, v1::GetReplayResponse& response) {
    if (absl::Status there = check_replay(api); !there.ok()) return there;
    fill(api, *response.mutable_replay());
    return absl::OkStatus();
}

ReplayServiceImpl::Reactor* ReplayServiceImpl::OpenReplay(Context* context,
                                                          const v1::OpenReplayRequest* request,
                                                          v1::OpenReplayResponse* response) {
    return unary_call(api_, api_.threads.control, context, request, response, check_replay, open_replay);
}

ReplayServiceImpl::Reactor* ReplayServiceImpl::CloseReplay(Context* context,
                                                           const v1::CloseReplayRequest* request,
                                                           v1::CloseReplayResponse* response) {
    return unary_call(api_, api_.threads.control, context, request, response, check_replay, close_replay);
}

ReplayServiceImpl::Reactor* ReplayServiceImpl::UpdateReplay(Context* context,
                                                            const v1::UpdateReplayRequest* request,
                                                            v1::UpdateReplayResponse* response) {
    return answer(context, update_replay(api_, *request, *response));
}

ReplayServiceImpl::Reactor* ReplayServiceImpl::GetReplay(Context* context,
                                                         const v1::GetReplayRequest* request,
                                                         v1::GetReplayResponse* response) {
    return answer(context, get_replay(api_, *request, *response));
}

}  // namespace kinevox
