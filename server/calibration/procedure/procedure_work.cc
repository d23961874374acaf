#include "server/calibration/procedure/procedure_work.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "server/calibration/procedure/procedure_kinds.h"

namespace kinevox {
namespace {

absl::StatusOr<std::vector<std::size_t>> chosen_cameras(const ProcedureRequest& request,
                                                        const std::vector<Camera>& cameras) {
    std::vector<std::size_t> chosen;
    for (std::size_t c = 0; c < cameras.size(); ++c)
        if (request.cameras.empty() ||
            std::ranges::find(request.cameras, cameras[c].name) != request.cameras.end())
            chosen.push_back(c);
    for (const std::string& name : request.cameras)
        if (!camera_named(cameras, name)) {
            std::vector<std::string> names;
            for (const Camera& camera : cameras) names.push_back(camera.name);
            return absl::NotFoundError(fmt::format("unknown camera '{}'; the cameras are {}",
                                                   name.substr(0, 80), fmt::join(names, ", ")));
        }
    if (request.kind != ProcedureKind::kIntrinsics && chosen.size() < 2)
        return absl::FailedPreconditionError("extrinsics need at least two cameras");
    if (request.kind == ProcedureKind::kExtrinsicsRefinePerson && chosen.size() != cameras.size())
        return absl::InvalidArgumentError("refining uses all cameras; name none");
    return chosen;
}

}  // namespace

absl::StatusOr<std::unique_ptr<ProcedureWork>> ProcedureWork::create(const ProcedureRequest& request,
                                                                     const std::vector<Camera>& cameras) {
    const auto chosen = chosen_cameras(request, cameras);
    if (!chosen.ok()) return chosen.status();
    switch (request.kind) {
        case ProcedureKind::kIntrinsics:
            return make_intrinsics_work(request, cameras, *chosen);
        case ProcedureKind::kExtrinsicsBoard:
            return make_board_work(request, cameras, *chosen);
        case ProcedureKind::kExtrinsicsWand:
            return make_wand_work(request, cameras, *chosen);
        case ProcedureKind::kExtrinsicsRefinePerson:
            return make_person_work(request, cameras);
    }
    return absl::InvalidArgumentError("unknown procedure kind");
}

absl::Status ProcedureWork::check_live_step(LiveStep what) const {
    if (what == LiveStep::kBoardOnFloor)
        return absl::InvalidArgumentError(
            "this procedure uses no board on the floor; only extrinsics from a board do");
    if (what == LiveStep::kEmptyScene)
        return absl::InvalidArgumentError(
            "this procedure uses no empty scene; only extrinsics from a wand do");
    return absl::OkStatus();
}

absl::Status check_clips(const std::vector<Camera>& cameras, std::span<const std::size_t> chosen,
                         ProcedureFiles& files) {
    if (!files.session_path.empty())
        return absl::InvalidArgumentError(
            "a session is for refining from a person; give a clip for each camera");
    if (files.clips.empty())
        return absl::InvalidArgumentError("no files are given; give a clip for each camera");
    if (files.stride < 1 || files.stride > 100'000)
        return absl::InvalidArgumentError(
            fmt::format("stride is {}; 1 to 100000 is allowed, or 0 for 1", files.stride));
    std::vector<std::string> arguments;
    for (const CameraClip& clip : files.clips) {
        if (!clip.file.is_absolute())
            return absl::InvalidArgumentError(
                fmt::format("camera {}: '{}' is not an absolute path; give the full path on the server",
                            clip.camera, clip.file.string()));
        if (std::ranges::none_of(chosen, [&](std::size_t c) { return cameras[c].name == clip.camera; }))
            return absl::NotFoundError(
                fmt::format("camera '{}' is not part of this procedure; name the clip as a camera that is",
                            clip.camera.substr(0, 80)));
        arguments.push_back(clip.camera + "=" + clip.file.string());
    }
    auto opened = open_clips(arguments);
    if (!opened.ok()) return opened.status();
    for (const CameraClip& clip : *opened) {
        const Camera& camera = *camera_named(cameras, clip.camera);
        if (clip.width != camera.width || clip.height != camera.height)
            return absl::InvalidArgumentError(fmt::format(
                "camera {}: {} is {} x {} px, the camera {} x {}; record the clip at the camera's size",
                clip.camera, clip.file.string(), clip.width, clip.height, camera.width, camera.height));
    }
    files.clips = *std::move(opened);
    return absl::OkStatus();
}

absl::Status check_clips_without_floor(const std::vector<Camera>& cameras,
                                       std::span<const std::size_t> chosen, ProcedureFiles& files) {
    if (files.board_on_floor_frame)
        return absl::InvalidArgumentError(
            "board_on_floor_frame is given; it applies to extrinsics from a board only");
    return check_clips(cameras, chosen, files);
}

void reject_view(CameraObservations& camera, const std::string& why, const std::string& in_words) {
    ++camera.rejections[why];
    if (!in_words.empty()) camera.latest_rejection_reason = in_words;
}

}  // namespace kinevox
