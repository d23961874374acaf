#include "kernels/cpu/packed_samples.h"

#include <algorithm>

#include "kernels/cpu/dispatch.h"
#include "kernels/cpu/parallel.h"

// Plain loops, which the compiler vectorises for each family that Highway chooses from at run time.
#ifdef KINEVOX_HAVE_HIGHWAY
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/cpu/packed_samples.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
HWY_BEFORE_NAMESPACE();
#endif

namespace kinevox::kernels::cpu::HWY_NAMESPACE {

constexpr int kMaxOffset = 15;  // above the lowest value

// samples: [sample][plane bytes]. False: they spread too far; `packed` then holds nothing of use.
bool pack_cell(const std::uint8_t* samples, int sample_count, int plane_bytes, std::uint8_t* packed) {
    constexpr int kPixels = kde::kCellPixels;
    for (int plane = 0; plane < plane_bytes; plane += kPixels) {
        std::uint8_t low[kPixels], high[kPixels];
        for (int x = 0; x < kPixels; ++x) low[x] = high[x] = samples[plane + x];
        for (int i = 1; i < sample_count; ++i) {
            const std::uint8_t* sample = samples + i * plane_bytes + plane;
            for (int x = 0; x < kPixels; ++x) low[x] = low[x] < sample[x] ? low[x] : sample[x];
            for (int x = 0; x < kPixels; ++x) high[x] = high[x] > sample[x] ? high[x] : sample[x];
        }
        std::uint8_t widest = 0;
        for (int x = 0; x < kPixels; ++x) {
            const auto width = static_cast<std::uint8_t>(high[x] - low[x]);
            widest = widest > width ? widest : width;
        }
        if (widest > kMaxOffset) return false;
        // Centred in the range, so that the next samples are likely to fit.
        for (int x = 0; x < kPixels; ++x) {
            const int spare = (kMaxOffset - (high[x] - low[x])) / 2;
            packed[plane + x] = static_cast<std::uint8_t>(low[x] > spare ? low[x] - spare : 0);
        }
    }
    for (int i = 0; i < sample_count; i += 2) {
        const std::uint8_t* first = samples + i * plane_bytes;
        const std::uint8_t* second = i + 1 < sample_count ? first + plane_bytes : first;
        std::uint8_t* __restrict pair = packed + (1 + i / 2) * plane_bytes;
#pragma GCC ivdep
        for (int x = 0; x < plane_bytes; ++x)
            pair[x] = static_cast<std::uint8_t>((first[x] - packed[x]) | ((second[x] - packed[x]) << 4));
    }
    return true;
}

// False: the sample does not fit what is packed, which stays as it was.
bool replace_sample(const std::uint8_t* sample, int slot, int plane_bytes, std::uint8_t* packed) {
    int above = 0;
    for (int x = 0; x < plane_bytes; ++x) above |= sample[x] - packed[x];  // a negative one has high bits
    if ((above & ~kMaxOffset) != 0) return false;
    std::uint8_t* __restrict pair = packed + (1 + slot / 2) * plane_bytes;
    const int shift = slot % 2 * 4, other = 0xf0 >> shift;
#pragma GCC ivdep
    for (int x = 0; x < plane_bytes; ++x)
        pair[x] = static_cast<std::uint8_t>((pair[x] & other) | ((sample[x] - packed[x]) << shift));
    return true;
}

}  // namespace kinevox::kernels::cpu::HWY_NAMESPACE

#ifdef KINEVOX_HAVE_HIGHWAY
HWY_AFTER_NAMESPACE();
#endif

#if !defined(KINEVOX_HAVE_HIGHWAY) || HWY_ONCE
namespace kinevox::kernels::cpu {
KINEVOX_EXPORT(pack_cell);
KINEVOX_EXPORT(replace_sample);

void PackedSamples::build(const BackgroundModel& model) {
    const std::size_t cells = model.cell_index(model.height, 0);
    cell_bytes_ = model.cell_bytes() * (1 + (model.sample_count + 1) / 2);
    data_.assign(cells * cell_bytes_, 0);
    narrow_.assign(cells, 0);
    parallel_for(0, model.height, 16, [&](int first, int last) {
        for (std::size_t cell = model.cell_index(first, 0); cell < model.cell_index(last, 0); ++cell)
            pack(model, cell);
    });
}

void PackedSamples::pack(const BackgroundModel& model, std::size_t cell) {
    const std::size_t bytes = model.cell_bytes();
    narrow_[cell] = KINEVOX_DISPATCH(pack_cell)(model.samples.data() + cell * model.sample_count * bytes,
                                                model.sample_count, static_cast<int>(bytes),
                                                data_.data() + cell * cell_bytes_);
}

void PackedSamples::replace(const BackgroundModel& model, std::size_t cell, int slot) {
    const std::size_t bytes = model.cell_bytes();
    const std::uint8_t* sample = model.samples.data() + (cell * model.sample_count + slot) * bytes;
    if (!narrow_[cell] || !KINEVOX_DISPATCH(replace_sample)(sample, slot, static_cast<int>(bytes),
                                                            data_.data() + cell * cell_bytes_))
        pack(model, cell);
}
}  // namespace kinevox::kernels::cpu
#endif
