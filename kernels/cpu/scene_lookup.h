// What the cameras of a frame set look up of each other (shared/kde_scene.h), several points at a time.
#pragma once

#include <span>

#include "kernels/shared/kde_shadow.h"

namespace kinevox::kernels::cpu {

inline constexpr int kPointsPerLookup = 8;
// Bytes after SceneView::votes that are read and not used.
inline constexpr int kVotePadding = 3;

// kde::light_of_floor() of each point.
struct FloorPoints {
    float x[kPointsPerLookup], y[kPointsPerLookup];  // m, world
};
void lights_of_floor(const kde::SceneView& view, const FloorPoints& points,
                     const kde::EvidenceParameters& parameters, float light[kPointsPerLookup]);

// kde::support_of()
float support_of(const kde::SupportRay& ray, std::span<const kde::SceneView* const> views);

}  // namespace kinevox::kernels::cpu
