#include "server/sync/align.h"

#include <fmt/format.h>

#include <algorithm>

namespace kinevox::sync {
namespace {

constexpr double kMinSeconds = 1;      // with a person in the image
constexpr double kHardlyMoves = 0.01;  // changed fraction of the silhouette per image; noise alone is below

constexpr double kPixels = 640;  // along the longer side: the unit of scatter and residuals

absl::Status check_seen(const std::vector<CameraMotion>& cameras, double fps) {
    for (const CameraMotion& camera : cameras) {
        const auto seen =
            std::ranges::count_if(camera.shapes, [](const SilhouetteShape& shape) { return shape.seen; });
        if (static_cast<double>(seen) >= kMinSeconds * fps) continue;
        return absl::FailedPreconditionError(fmt::format(
            "camera {}: a person is visible in only {} of {} images; {:g} s are needed. Check that its "
            "background belongs to this session and that the person walks through its view",
            camera.camera.name, seen, camera.shapes.size(), kMinSeconds));
    }
    return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Alignment> align(const std::vector<CameraMotion>& cameras, double fps,
                                const AlignOptions& options) {
    if (cameras.size() < 2)
        return absl::FailedPreconditionError("the session has one camera; alignment needs at least two");
    if (absl::Status seen = check_seen(cameras, fps); !seen.ok()) return seen;
    Alignment out;
    EvidenceOptions evidence;
    OffsetOptions offsets;
    evidence.fps = offsets.fps = fps;
    offsets.max_offset_s = options.max_offset_s;
    int max_px = 0;
    for (const CameraMotion& camera : cameras)
        max_px = std::max({max_px, camera.camera.width, camera.camera.height});
    evidence.pixel_px = offsets.pixel_px = max_px / kPixels;
    std::vector<std::string> names;
    for (const CameraMotion& camera : cameras) {
        names.push_back(camera.camera.name);
        out.movements.push_back(movement_signals(camera, fps));
    }
    std::vector<PairEvidence> pairs;
    for (PairSignals& signals : pair_signals(cameras, fps, {options.use_extrinsics})) {
        out.used_extrinsics = out.used_extrinsics || !signals.equal_px.empty();
        pairs.emplace_back(std::move(signals), evidence);
    }
    auto solution = solve_offsets(pairs, names, offsets);
    if (!solution.ok()) {
        // The cause is more useful than the failure.
        for (std::size_t c = 0; c < cameras.size(); ++c)
            if (out.movements[c].hardly_moves < kHardlyMoves)
                return absl::FailedPreconditionError(fmt::format("{} (camera {}: the person hardly moves)",
                                                                 std::string(solution.status().message()),
                                                                 names[c]));
        return solution.status();
    }
    out.solution = *std::move(solution);
    return out;
}

}  // namespace kinevox::sync
