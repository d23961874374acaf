#include "server/calibration/procedure_work.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

#include "server/calibration/procedure_works.h"

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
            return absl::NotFoundError(fmt::format("there is no camera '{}'; there are {}",
                                                   name.substr(0, 80), fmt::join(names, ", ")));
        }
    if (request.kind != ProcedureKind::kIntrinsics && chosen.size() < 2)
        return absl::FailedPreconditionError("one camera has no place among others; take two or more");
    if (request.kind == ProcedureKind::kRefinePerson && chosen.size() != cameras.size())
        return absl::InvalidArgumentError("refining takes all cameras; name none");
    return chosen;
}

}  // namespace

absl::StatusOr<std::unique_ptr<ProcedureWork>> ProcedureWork::create(const ProcedureRequest& request,
                                                                     const std::vector<Camera>& cameras) {
    const auto chosen = chosen_cameras(request, cameras);
    if (!chosen.ok()) return chosen.status();
    switch (request.kind) {
        case ProcedureKind::kIntrinsics:
            return make_lens_work(request, cameras, *chosen);
        case ProcedureKind::kExtrinsicsBoard:
            return make_board_work(request, cameras, *chosen);
        case ProcedureKind::kExtrinsicsWand:
            return make_wand_work(request, cameras, *chosen);
        case ProcedureKind::kRefinePerson:
            return make_person_work(request, cameras);
    }
    return absl::InvalidArgumentError("a procedure of a kind that nobody wrote");
}

absl::Status ProcedureWork::check_taking(Taking what) const {
    if (what == Taking::kBoardOnFloor)
        return absl::InvalidArgumentError(
            "no board lies on the floor in this procedure; only places from a board take it");
    if (what == Taking::kEmptyScene)
        return absl::InvalidArgumentError(
            "this procedure needs no picture of the empty scene; only the wand does");
    return absl::OkStatus();
}

absl::Status check_clips(const std::vector<Camera>& cameras, std::span<const std::size_t> chosen,
                         ProcedureFiles& files) {
    if (!files.session.empty())
        return absl::InvalidArgumentError(
            "a session is for refining from a person; give a clip for each camera");
    if (files.clips.empty())
        return absl::InvalidArgumentError("no files are given; give a clip for each camera");
    if (files.every < 1 || files.every > 100'000)
        return absl::InvalidArgumentError(
            fmt::format("every is {}; 1 to 100000 is allowed, or 0 for each", files.every));
    std::vector<std::string> arguments;
    for (const CameraClip& clip : files.clips) {
        if (!clip.file.is_absolute())
            return absl::InvalidArgumentError(
                fmt::format("camera {}: '{}' is no absolute path; the daemon reads files by their full names "
                            "on its own machine",
                            clip.camera, clip.file.string()));
        if (std::ranges::none_of(chosen, [&](std::size_t c) { return cameras[c].name == clip.camera; }))
            return absl::NotFoundError(
                fmt::format("camera '{}' takes no part in this procedure; name the clip as one "
                            "that does",
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

void reject_view(ObservedCamera& camera, const std::string& why, const std::string& in_words) {
    ++camera.rejected[why];
    if (!in_words.empty()) camera.last_rejection = in_words;
}

}  // namespace kinevox
