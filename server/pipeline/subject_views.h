// Separates the silhouettes of several subjects by the projections of their volumes.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "common/camera.h"
#include "kernels/cpu/run_components.h"
#include "kernels/segmentation.h"
#include "kernels/types.h"
#include "server/pose/pose_candidate.h"

namespace kinevox {

// What the cameras show of one subject beside others.
struct SubjectViews {
    // Per camera, the silhouettes inside the subject's projection, and what is connected to that alone: a
    // hole in one silhouette takes the volume behind it, but not the other cameras' silhouettes.
    std::vector<kernels::Silhouettes> own;
    std::vector<ForegroundPart> shared;  // per camera, where another subject near this one projects to
    std::vector<float> hidden_fraction;  // per camera, of the own pixels that a nearer subject may hide
};

// Keeps its memory. Not thread safe.
class SubjectSeparator {
  public:
    // `shapes`: coarse volumes, at least two; `out` has as many entries, empty or from an earlier call, null
    // for a shape whose views are not wanted. Silhouettes without pixels are skipped.
    void separate(const std::vector<Camera>& cameras, const std::vector<kernels::CameraModel>& models,
                  std::span<const kernels::Silhouettes> silhouettes,
                  std::span<const kernels::VoxelVolume* const> shapes, std::span<SubjectViews* const> out);

  private:
    struct Projection {
        std::vector<std::uint8_t> mask;
        kernels::Rect box;
        double distance_m = 0;  // of the volume's centre from the camera
    };
    // Of one camera.
    struct View {
        std::vector<Projection> projections;  // per shape
        std::vector<std::uint8_t> outside;    // foreground outside all projections
        kernels::cpu::RunComponents components;
        std::vector<int> beside;  // per component, the shape
    };
    static void extend_projections(const kernels::Silhouettes& seen, View& view);

    std::vector<View> views_;
};

}  // namespace kinevox
