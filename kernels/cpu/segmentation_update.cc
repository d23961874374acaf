#include <algorithm>

#include "kernels/cpu/dispatch.h"
#include "kernels/cpu/packed_samples.h"
#include "kernels/cpu/segmentation_model.h"
#include "kernels/shared/kde_update.h"

// Plain loops, which the compiler vectorises for each family that Highway chooses from at run time.
#ifdef KINEVOX_HAVE_HIGHWAY
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/cpu/segmentation_update.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
HWY_BEFORE_NAMESPACE();
#endif

namespace kinevox::kernels::cpu::HWY_NAMESPACE {

using kde::kCellPixels;

// Takes `fresh` where `mask` is 255 and `old` where it is 0; no branch, so that loops become vectors.
inline std::uint8_t chosen(std::uint8_t mask, int fresh, std::uint8_t old) {
    return static_cast<std::uint8_t>((fresh & mask) | (old & ~mask));
}

// kde::learn_background_value() for the pixels of a cell where `mask` is 255.
void learn_values(std::uint8_t* samples, std::uint8_t* scales, std::uint8_t* references, int channels,
                  const std::uint8_t* values, const std::uint8_t* mask, const kde::UpdateParameters& p) {
    const int bytes = channels * kCellPixels;
    for (int plane = 0; plane < bytes; plane += kCellPixels) {
        std::uint8_t *scale = scales + plane, *reference = references + plane;
        std::uint8_t* slot = samples + p.short_term_slot * bytes + plane;
        const std::uint8_t* previous = samples + kde::previous_slot(p) * bytes + plane;
        const std::uint8_t* value = values + plane;
        if (p.sample_count > 1)
#pragma GCC ivdep
            for (int x = 0; x < kCellPixels; ++x)
                scale[x] = chosen(mask[x], kde::stepped_scale(scale[x], value[x], previous[x], p.max_scale),
                                  scale[x]);
#pragma GCC ivdep
        for (int x = 0; x < kCellPixels; ++x)
            reference[x] = chosen(mask[x], kde::stepped_reference(reference[x], value[x]), reference[x]);
#pragma GCC ivdep
        for (int x = 0; x < kCellPixels; ++x) slot[x] = chosen(mask[x], value[x], slot[x]);
        if (p.long_term_slot < 0) continue;
        std::uint8_t* long_slot = samples + p.long_term_slot * bytes + plane;
#pragma GCC ivdep
        for (int x = 0; x < kCellPixels; ++x) long_slot[x] = chosen(mask[x], value[x], long_slot[x]);
    }
}

// Classifies a cell's pixels for the update, 255 or 0 each: `learn`: background; `strange`: neither
// background nor subject, only for these the visits are counted. Returns whether any is strange.
bool judge_pixels(const std::uint8_t* density, const std::uint8_t* keep_out, int pixels, std::uint8_t* learn,
                  std::uint8_t* strange, std::uint8_t* visits) {
    int any_strange = 0;
#pragma GCC ivdep
    for (int x = 0; x < pixels; ++x) {
        const int background = density[x] >= kde::kLearnDensity ? 255 : 0, free = keep_out[x] ? 0 : 255;
        learn[x] = static_cast<std::uint8_t>(background & free);
        strange[x] = static_cast<std::uint8_t>(~background & free);
        any_strange |= strange[x];
        visits[x] = static_cast<std::uint8_t>(visits[x] & strange[x]);
    }
    return any_strange != 0;
}

}  // namespace kinevox::kernels::cpu::HWY_NAMESPACE

#ifdef KINEVOX_HAVE_HIGHWAY
HWY_AFTER_NAMESPACE();
#endif

#if !defined(KINEVOX_HAVE_HIGHWAY) || HWY_ONCE
namespace kinevox::kernels::cpu {

using kde::kCellPixels;

KINEVOX_EXPORT(learn_values);
KINEVOX_EXPORT(judge_pixels);

kde::UpdateParameters update_parameters(const SegmentationOptions& options, std::int64_t visit) {
    kde::UpdateParameters p;
    p.sample_count = options.samples;
    const int short_term = std::max(1, options.samples / 4);
    const int long_term = options.samples - short_term;
    p.short_term_begin = long_term;
    p.short_term_slot = long_term + static_cast<int>(visit % short_term);
    if (long_term > 0 && visit % options.long_term_interval == options.long_term_interval - 1)
        p.long_term_slot = static_cast<int>(visit / options.long_term_interval % long_term);
    p.absorb_visits = std::clamp(options.absorb_frames / std::max(options.update_interval, 1), 1, 255);
    p.max_scale = std::clamp(static_cast<int>(256.0f / options.min_bandwidth), 8, 255);
    return p;
}

void update_row(BackgroundModel& model, PackedSamples& packed, int y, const ModelUpdate& update,
                const SegmentationOptions& options) {
    const kde::UpdateParameters p = update_parameters(options, update.visit);
    for (int k = 0; k < model.cells_per_row; ++k) {
        const std::size_t cell = model.cell_index(y, k), bytes = cell * model.cell_bytes();
        const int pixels = std::min(kCellPixels, model.width - k * kCellPixels);
        const std::uint8_t* density = update.density + cell * kCellPixels;
        const std::uint8_t* keep_out =
            update.keep_out + static_cast<std::size_t>(y) * model.width + k * kCellPixels;
        std::uint8_t* visits = model.candidate_visits.data() + cell * kCellPixels;
        std::uint8_t learn[kCellPixels] = {}, strange[kCellPixels] = {};
        const bool any_strange =
            KINEVOX_DISPATCH(judge_pixels)(density, keep_out, pixels, learn, strange, visits);
        KINEVOX_DISPATCH(learn_values)
        (model.cell_samples(y, k), model.bandwidth_scale.data() + bytes, model.reference.data() + bytes,
         model.channels, update.cells + bytes, learn, p);
        update_log_peak(model, cell);
        bool absorbed = false;
        for (int x = 0; any_strange && x < pixels; ++x)
            if (strange[x]) {
                kde::watch_strange_value(
                    update.cells + bytes + x, model.channels, p,
                    {model.cell_samples(y, k) + x, model.bandwidth_scale.data() + bytes + x,
                     model.reference.data() + bytes + x, model.candidate.data() + bytes + x, visits + x});
                absorbed = absorbed || visits[x] == 0;
            }
        if (absorbed) {
            packed.pack(model, cell);
            continue;
        }
        packed.replace(model, cell, p.short_term_slot);
        if (p.long_term_slot >= 0) packed.replace(model, cell, p.long_term_slot);
    }
}

}  // namespace kinevox::kernels::cpu
#endif
