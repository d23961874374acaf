#include "server/sync/align.h"

#include <fmt/format.h>

#include <algorithm>

namespace kinevox::sync {
namespace {

constexpr double kMinSeconds = 1;  // with somebody in the picture
constexpr double kHardlyMoves =
    0.01;  // part of the silhouette that differs from picture to picture: noise alone makes less

constexpr double kPixels = 640;  // along the longer side, that scatter and misses are counted in

absl::Status check_seen(const std::vector<CameraMotion>& cameras, double fps) {
    for (const CameraMotion& camera : cameras) {
        const auto seen =
            std::ranges::count_if(camera.shapes, [](const SeenShape& shape) { return shape.seen; });
        if (static_cast<double>(seen) >= kMinSeconds * fps) continue;
        return absl::FailedPreconditionError(fmt::format(
            "camera {}: somebody is seen in {} of its {} pictures only; {:g} s are needed. Is its "
            "background that of this place, "
            "and does the person walk through its view?",
            camera.camera.name, seen, camera.shapes.size(), kMinSeconds));
    }
    return absl::OkStatus();
}

}  // namespace

absl::StatusOr<Alignment> align(const std::vector<CameraMotion>& cameras, double fps,
                                const AlignOptions& options) {
    if (cameras.size() < 2)
        return absl::FailedPreconditionError("the session has one camera; there is nothing to align it with");
    if (absl::Status seen = check_seen(cameras, fps); !seen.ok()) return seen;
    Alignment out;
    EvidenceOptions evidence;
    OffsetOptions offsets;
    evidence.fps = offsets.fps = fps;
    offsets.max_shift_s = options.max_shift_s;
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
    for (PairSignals& signals : pair_signals(cameras, fps, {options.use_places})) {
        out.used_places = out.used_places || !signals.equal_px.empty();
        pairs.emplace_back(std::move(signals), evidence);
    }
    auto solution = solve_offsets(pairs, names, offsets);
    if (!solution.ok()) {
        // Why it cannot be told is worth more than that it cannot.
        for (std::size_t c = 0; c < cameras.size(); ++c)
            if (out.movements[c].hardly_moves < kHardlyMoves)
                return absl::FailedPreconditionError(
                    fmt::format("{} (camera {}: who stands there hardly moves)",
                                std::string(solution.status().message()), names[c]));
        return solution.status();
    }
    out.solution = *std::move(solution);
    return out;
}

}  // namespace kinevox::sync
