// Subject or shadow, on the CPU: gives doubtful pixels their evidence by the rule of shared/kde_shadow.h.
#pragma once

#include <functional>
#include <span>
#include <vector>

#include "kernels/cpu/segmentation_evidence.h"
#include "kernels/cpu/segmentation_model.h"
#include "kernels/cpu/segmentation_search.h"
#include "kernels/floor_grid.h"
#include "kernels/shared/kde_shadow.h"

namespace kinevox::kernels::cpu {

// Planes and bytes of the frame, all of the segmenter's size; see CpuSegmenter.
struct ShadowPlanes {
    Plane *factor, *residual, *neighbourhood, *product, *energy, *square, *misfit, *evidence;
    const std::uint8_t* cells;    // [row][cell][channel][64]
    const std::uint8_t* density;  // [row][cell][64]
    const std::uint8_t* active;   // per cell, its groups
    const float* log_foreground;  // per histogram bin
};

class ShadowJudge {
  public:
    // Gets each doubtful pixel's features and evidence; for learning the rule.
    using Observer = std::function<void(int x, int y, const float* features, float evidence)>;

    void set_camera(const CameraModel& camera);
    void set_observer(Observer observer) { observer_ = std::move(observer); }

    // The patches' misfit of the active groups; before judge().
    void measure_patches(const CellBox& box, std::span<const GroupSpan> active_span,
                         const ShadowPlanes& planes, int channels) const;
    // Replaces the evidence of doubtful pixels; after set_camera(). `others`: of cameras that see the same
    // instant.
    void judge(const CellBox& box, std::span<const GroupSpan> active_span, const ShadowPlanes& planes,
               const BackgroundModel& model, const kde::EvidenceParameters& parameters,
               std::span<const kde::SceneView* const> others) const;

  private:
    struct FloorLights;
    template <int kChannels>
    void judge_row(int y, const GroupSpan& span, const ShadowPlanes& planes, const BackgroundModel& model,
                   const kde::EvidenceParameters& parameters, FloorLights& floor) const;

    Projector camera_{};
    FloorDirections directions_;
    Observer observer_;
};

}  // namespace kinevox::kernels::cpu
