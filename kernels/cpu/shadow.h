// Subject or shadow, on the CPU: gives doubtful pixels their evidence by the rule of shared/kde_shadow.h.
#pragma once

#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "kernels/cpu/faint_blocks.h"
#include "kernels/cpu/segmentation_evidence.h"
#include "kernels/cpu/segmentation_model.h"
#include "kernels/cpu/segmentation_search.h"
#include "kernels/floor_grid.h"
#include "kernels/shared/kde_shadow.h"

namespace kinevox::kernels::cpu {

// Planes and bytes of the frame, all of the segmenter's size; see CpuSegmenter.
struct ShadowPlanes {
    Plane *factor, *residual, *neighbourhood, *product, *energy, *square, *misfit, *distance, *colour, *voted,
        *evidence;
    const std::uint8_t* density;  // [row][cell][64]
    const std::uint8_t* active;   // per cell, its groups
    const std::int8_t* votes;     // of this camera, see kde::SceneView
    int vote_columns;
    const FaintBlocks* faint;
    float noise_factor;  // see kde::noise_factor()
};

class ShadowJudge {
  public:
    // Gets each doubtful pixel's features and evidence; for learning the rule.
    using Observer = std::function<void(int x, int y, const float* features, float evidence)>;

    void set_camera(const CameraModel& camera);
    void set_observer(Observer observer) { observer_ = std::move(observer); }

    // Bounds of what is plainly the subject, px; for the other cameras (kde::SceneView).
    void bounds_of(const Rect& subject, float bounds[4]) const {
        subject_bounds(subject, model_, directions_, bounds);
    }
    // Replaces the evidence of doubtful pixels; after set_camera(). `others`: of cameras that see the same
    // instant.
    void judge(const CellBox& box, std::span<const GroupSpan> active_span, const ShadowPlanes& planes,
               const BackgroundModel& model, const kde::EvidenceParameters& parameters,
               std::span<const kde::SceneView* const> others);

  private:
    struct FloorLights;
    struct Supports;
    void find_doubtful(int y, const GroupSpan& span, const ShadowPlanes& planes, const BackgroundModel& model,
                       float limit, Supports& supports);
    void measure_patches(const CellBox& box, const ShadowPlanes& planes, int channels) const;
    void find_lights(int y0, int y1, const kde::EvidenceParameters& parameters, FloorLights& floor) const;
    void judge_row(int y, const ShadowPlanes& planes, const kde::EvidenceParameters& parameters, int channels,
                   const FloorLights& floor);
    void add_votes(const CellBox& box, const ShadowPlanes& planes);
    kde::FloorGrid grid() const;

    // Of the frame: per group its pixels that the rule decides, as bits, and the support of its halves; per
    // row the groups from the first to the last with such pixels.
    std::vector<std::uint16_t> doubtful_;
    std::vector<float> support_;
    std::vector<GroupSpan> judged_span_;
    // Per block of kde::kVoteBlock_px: pixels that the votes would change; whether they may.
    std::vector<std::uint8_t> changed_, added_;
    std::vector<int> sums_;  // scratch of add_votes()
    int groups_per_row_ = 0;
    CameraModel model_;
    Projector camera_{};
    FloorDirections directions_;
    Observer observer_;
};

}  // namespace kinevox::kernels::cpu
