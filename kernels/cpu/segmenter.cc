#include "kernels/cpu/segmenter.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

#include "kernels/cpu/parallel.h"
#include "kernels/cpu/scene_lookup.h"
#include "kernels/cpu/shadow_training.h"
#include "kernels/shared/faint_weights.h"

namespace kinevox::kernels {
namespace cpu {

using kde::kCellPixels;

CpuSegmenter::CpuSegmenter(int width, int height, int channels, const SegmentationOptions& options)
    : width_(width),
      height_(height),
      channels_(channels),
      options_(options),
      tables_(make_density_tables(options.samples)),
      colours_(channels) {
    parameters_.darkest = options.darkest_shadow;
    parameters_.brightest = options.brightest_light;
    parameters_.log_prior_light = std::log(options.light_change_prior);
    set_judge_faint(options.judge_faint);
    for (int i = 0; i < 256; ++i)
        log_lit_[i] =
            std::log(std::max(i, 1) / 255.0f * static_cast<float>(kde::saturation(options.samples)));
    for (int i = 0; i < 256; ++i) {
        const float evidence = (static_cast<float>(i) - 127.5f) / 127.5f * parameters_.limit;
        probability_of_[i] = static_cast<std::uint8_t>(std::lround(255.0f / (1.0f + std::exp(-evidence))));
    }
}

void CpuSegmenter::set_judge_faint(bool judge) {
    if (options_.judge_faint && !judge) {
        faint_ = {};
        noise_factor_ = 1;
    }
    options_.judge_faint = judge;
    parameters_.shadow = judge ? kde::kFaintRule : kde::ShadowRule{};
}

void CpuSegmenter::learn(std::span<const ImageView> empty_scene) {
    if (empty_scene.empty())
        throw std::invalid_argument("segmentation: the background needs at least one image");
    for (const ImageView& image : empty_scene) check_image(image, width_, height_, channels_);
    model_ = learn_background(empty_scene, width_, height_, channels_, options_);
    if (keep_learned_) learned_model_ = model_;
    begin();
}

void CpuSegmenter::forget_frames() {
    if (!learned_ || !keep_learned_)
        throw std::logic_error(
            "segmentation: no learned background was kept; call keep_learned() before learn()");
    model_ = learned_model_;
    begin();
}

// The first frame is still to come.
void CpuSegmenter::begin() {
    packed_.build(model_);
    const std::size_t cells = model_.cell_index(height_, 0);
    cells_.assign(cells * model_.cell_bytes(), 0);
    density_.assign(cells * kCellPixels, 255);
    candidates_.assign(cells, 0);
    active_.assign(cells, 0);
    searched_.assign(cells, 0);
    active_span_.assign(height_, {});
    lit_.assign(cells, 0);
    looked_.assign(cells, kde::kSamplesPerLook);
    for (Plane* plane : {&weighted_value_, &weighted_energy_, &factor_, &residual_, &neighbourhood_,
                         &product_, &energy_, &square_, &misfit_, &distance_, &colour_, &voted_})
        plane->resize(model_.cells_per_row, height_, 0);
    for (Plane* plane : {&evidence_, &smoothed_})
        plane->resize(model_.cells_per_row, height_, -parameters_.limit);
    keep_out_.assign(static_cast<std::size_t>(width_) * height_, 0);
    colours_.clear();
    frame_ = 0;
    learned_ = true;
}

void CpuSegmenter::set_camera(const CameraModel& camera) {
    scene_.camera = make_projector(camera, "segmentation");
    shadows_.set_camera(camera);
    scene_.vote_columns = (width_ + kde::kVoteBlock_px - 1) / kde::kVoteBlock_px;
    votes_.assign(static_cast<std::size_t>(scene_.vote_columns) *
                          ((height_ + kde::kVoteBlock_px - 1) / kde::kVoteBlock_px) +
                      kVotePadding,
                  0);
    scene_.votes = votes_.data();
    has_camera_ = true;
}

void CpuSegmenter::begin_frame(const ImageView& image, const SegmentationPrior& prior) {
    if (!learned_) throw std::logic_error("segmentation: learn() the background before segmenting");
    check_image(image, width_, height_, channels_);
    image_ = image;
    prior_ = prior;
    Rect asked{0, 0, width_, height_};
    if (!prior.full_pass && !prior.region.empty()) {
        const Rect& r = prior.region;
        asked = {std::max(r.x0, 0), std::max(r.y0, 0), std::min(r.x1, width_), std::min(r.y1, height_)};
        if (asked.empty()) asked = {};
    }
    work_ = {asked.y0, asked.y1, asked.x0 / kCellPixels, (asked.x1 + kCellPixels - 1) / kCellPixels};
    mark_searched(prior, work_, width_, height_, searched_.data());
    inverse_gain_ = fixed_point_inverse(estimate_gain(model_, image));
    scene_.image = image.data;
    scene_.image_stride = image.stride;
    scene_.reference = model_.reference.data();
    scene_.scale = model_.bandwidth_scale.data();
    std::copy(inverse_gain_.begin(), inverse_gain_.end(), scene_.inverse_gain);
    scene_.channels = channels_;
    scene_.cells_per_row = model_.cells_per_row;
    parallel_for(work_.y0, work_.y1, kSegmenterRowsPerTask,
                 [&](int first, int last) { density_rows(image, first, last, work_.k0, work_.k1, true); });
    if (options_.judge_faint) {
        const kde::BlockDifference usual = faint_.measure(model_, image, inverse_gain_);
        noise_factor_ = kde::noise_factor(usual, channels_, parameters_.noise_fraction);
        faint_.find(model_, cells_.data(), searched_.data(), work_, usual);
    }
    active_box_ = find_active(work_);
    if (!active_box_.empty()) {
        fit_light(active_box_);
        light_around(active_box_);
        evidence(active_box_);
    }
    if (has_camera_) vote(active_box_);
}

void CpuSegmenter::decide(std::span<const Segmenter* const> others, Silhouettes& out) {
    clear(out);
    out.width = width_, out.height = height_;
    out.searched = {work_.k0 * kCellPixels, work_.y0, std::min(work_.k1 * kCellPixels, width_), work_.y1};
    if (active_box_.empty()) return measure({}, out);
    judge_shadows(active_box_, others);
    threshold(active_box_, out);
    const Rect box{active_box_.k0 * kCellPixels, active_box_.y0,
                   std::min(active_box_.k1 * kCellPixels, width_), active_box_.y1};
    measure(silhouettes(box, out.searched, prior_, out), out);
}

void CpuSegmenter::end_frame(const Silhouettes& out) {
    update_model(image_, prior_, out);
    ++frame_;
}

void observe_shadows(Segmenter& segmenter, ShadowJudge::Observer observer) {
    auto* const cpu = dynamic_cast<CpuSegmenter*>(&segmenter);
    if (!cpu) throw std::invalid_argument("shadow observer: not a segmenter of the CPU");
    cpu->observe(std::move(observer));
}

}  // namespace cpu

std::unique_ptr<Segmenter> make_segmenter_cpu(int width, int height, int channels,
                                              const SegmentationOptions& options) {
    return std::make_unique<cpu::CpuSegmenter>(width, height, channels, options);
}

}  // namespace kinevox::kernels
