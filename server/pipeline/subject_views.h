// Separates the silhouettes of several subjects by the projections of their volumes.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/camera.h"
#include "kernels/segmentation.h"
#include "kernels/types.h"

namespace kinevox {

// What the cameras show of one subject beside others.
struct SubjectViews {
    std::vector<kernels::Silhouettes> own;  // per camera, the silhouettes inside the subject's projection
    // Per camera 255 in foreground where another subject near this one projects to, of the image's size: it
    // may show either of them. Empty: none is near.
    std::vector<std::vector<std::uint8_t>> shared;
    std::vector<float> hidden_fraction;  // per camera, of the own pixels that a nearer subject may hide
};

// `shapes`: coarse volumes, at least two; `out` has as many entries. Silhouettes without pixels are skipped.
void separate_subjects(const std::vector<Camera>& cameras, const std::vector<kernels::CameraModel>& models,
                       std::span<const kernels::Silhouettes> silhouettes,
                       std::span<const kernels::VoxelVolume* const> shapes,
                       std::span<SubjectViews* const> out);

}  // namespace kinevox
