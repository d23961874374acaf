#include "server/quality/camera_time.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include "server/sync/offsets.h"

namespace kinevox::quality {

std::optional<RigHypothesis> measure_camera_time(const Session& session) {
    constexpr int kMaxSide_px = 640;
    // Nats. A person who stands and sways matches at a wrong shift with 50.
    constexpr double kMinEvidence = 100;
    const auto motion = sync::read_motion(session, {.max_side_px = kMaxSide_px});
    if (!motion.ok() || motion->size() < 2) return std::nullopt;
    const auto alignment = sync::align(*motion, session.fps, {.max_offset_s = 5});
    if (!alignment.ok()) return std::nullopt;
    for (const sync::CameraFit& camera : alignment->solution.cameras)
        if (camera.evidence < kMinEvidence) return std::nullopt;
    std::vector<double> late;  // frames, against the session's offsets
    for (std::size_t c = 0; c < motion->size(); ++c)
        late.push_back(session.fps *
                       (alignment->solution.cameras[c].offset_s - session.cameras[c].offset_s.value_or(0)));
    std::vector<double> sorted = late;
    std::ranges::sort(sorted);
    // The lower of two middle values: one of two cameras is always off.
    const double common = sorted[(sorted.size() - 1) / 2];
    const auto worst =
        std::ranges::max_element(late, {}, [&](double frames) { return std::abs(frames - common); });
    return RigHypothesis{.camera = static_cast<std::size_t>(worst - late.begin()),
                         .shift_frames = *worst - common};
}

}  // namespace kinevox::quality
