// Segmentation on the CPU: one camera's model of the background and the frame that it decides. A frame goes
// through begin_frame() (segmenter_evidence.cc) and decide() and end_frame() (segmenter_silhouettes.cc); the
// loops over pixels are in the headers below, SIMD where it pays.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "kernels/cpu/aligned_vector.h"
#include "kernels/cpu/faint_blocks.h"
#include "kernels/cpu/foreground_colours.h"
#include "kernels/cpu/packed_samples.h"
#include "kernels/cpu/run_components.h"
#include "kernels/cpu/segmentation_density.h"
#include "kernels/cpu/segmentation_evidence.h"
#include "kernels/cpu/segmentation_masks.h"
#include "kernels/cpu/segmentation_model.h"
#include "kernels/cpu/segmentation_search.h"
#include "kernels/cpu/shadow.h"
#include "kernels/segmentation_memory.h"
#include "kernels/shared/kde_evidence.h"

namespace kinevox::kernels::cpu {

inline constexpr int kSegmenterRowsPerTask = 16;  // of its parallel loops

class CpuSegmenter final : public RewindableSegmenter {
  public:
    CpuSegmenter(int width, int height, int channels, const SegmentationOptions& options);
    void learn(std::span<const ImageView> empty_scene) override;
    bool learned() const override { return learned_; }
    void set_judge_faint(bool judge) override;
    void keep_learned() override { keep_learned_ = true; }
    void forget_frames() override;
    void set_camera(const CameraModel& camera) override;
    void begin_frame(const ImageView& image, const SegmentationPrior& prior) override;
    void decide(std::span<const Segmenter* const> others, Silhouettes& out) override;
    void end_frame(const Silhouettes& out) override;
    const kde::SceneView* scene() const override { return has_camera_ ? &scene_ : nullptr; }
    void observe(ShadowJudge::Observer observer) { shadows_.set_observer(std::move(observer)); }

  private:
    void begin();
    void clear(Silhouettes& out) const;
    CellSamples samples_of(int y, int k);
    SamplesAhead samples_ahead(int y, int k);
    void prefetch(const std::uint8_t* cell) const;
    void density_rows(const ImageView& image, int y0, int y1, int k0, int k1, bool searched);
    CellBox find_active(const CellBox& work);
    void fit_light(const CellBox& active);
    void light_around(const CellBox& active);
    void evidence(const CellBox& active);
    void vote(const CellBox& active);
    void judge_shadows(const CellBox& active, std::span<const Segmenter* const> others);
    void threshold(const CellBox& active, Silhouettes& out);
    Rect silhouettes(const Rect& active, const Rect& work, const SegmentationPrior& prior, Silhouettes& out);
    void learn_colours(const Rect& box, const Silhouettes& out);
    void update_model(const ImageView& image, const SegmentationPrior& prior, const Silhouettes& out);
    void measure(const Rect& box, Silhouettes& out) const;
    EvidenceCell cell_at(int y, int k) const;

    int width_, height_, channels_;
    SegmentationOptions options_;
    kde::DensityTables tables_;
    kde::EvidenceParameters parameters_;
    float log_lit_[256];
    std::uint8_t probability_of_[256];  // of evidence in steps of limit / 128
    bool learned_ = false, keep_learned_ = false;
    std::int64_t frame_ = 0;
    BackgroundModel model_, learned_model_;  // the latter empty unless it is kept
    PackedSamples packed_;
    std::array<std::uint16_t, 3> inverse_gain_{};
    AlignedVector<std::uint8_t> cells_, density_;
    std::vector<std::uint8_t>
        candidates_;                    // per cell, the groups near its unsure pixels; 0: plainly background
    std::vector<std::uint8_t> active_;  // per cell, the groups that are looked at
    std::vector<std::uint8_t> searched_;  // per cell, whether its density is this frame's
    std::vector<std::uint8_t> spread_;    // scratch of find_active
    std::vector<GroupSpan> active_span_;  // per row, from the first active group to the last
    std::vector<std::uint8_t> lit_;     // per cell, the groups for which the planes hold values of their own
    std::vector<std::uint8_t> looked_;  // per cell, samples that are in its density
    Plane weighted_value_, weighted_energy_, factor_, residual_, neighbourhood_, evidence_, smoothed_;
    Plane product_, energy_, square_, misfit_, distance_, colour_, voted_;  // see ShadowPlanes
    ShadowJudge shadows_;
    FaintBlocks faint_;               // none unless options_.judge_faint
    float noise_factor_ = 1;          // of the image, with options_.judge_faint
    std::vector<std::int8_t> votes_;  // see kde::SceneView
    bool has_camera_ = false;
    kde::SceneView scene_;
    // The frame between begin_frame() and end_frame().
    ImageView image_;
    SegmentationPrior prior_;
    CellBox work_, active_box_;
    ForegroundColours colours_;
    std::vector<float> log_foreground_;
    std::vector<std::int32_t> colour_counts_;
    std::vector<std::uint8_t> keep_out_;
    RunComponents components_;
    BorderRefiner border_;
};

}  // namespace kinevox::kernels::cpu
