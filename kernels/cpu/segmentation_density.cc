#include "kernels/cpu/segmentation_density.h"

#include <algorithm>
#include <cmath>
#include <cstring>

// foreach_target.h reads this file once a processor family; this part belongs to all of them.
#ifndef KINEVOX_SEGMENTATION_DENSITY_PLAIN
#define KINEVOX_SEGMENTATION_DENSITY_PLAIN
namespace kinevox::kernels::cpu {
// The plain forms: where Highway is missing, at a image's right edge, and on processors without byte
// vectors.
inline void split_plain(const std::uint8_t* interleaved, int pixels, int channels,
                        const std::uint16_t* gain_64, std::uint8_t* cell) {
    for (int c = 0; c < channels; ++c) {
        std::uint8_t* plane = cell + c * kde::kCellPixels;
        for (int x = 0; x < pixels; ++x) {
            const unsigned value = interleaved[x * channels + c];
            const unsigned scaled = std::min(255u, (((value * gain_64[c]) >> 8) + 32) >> 6);
            plane[x] = static_cast<std::uint8_t>(value >= 253 ? 255 : scaled);
        }
        std::memset(plane + pixels, 0, kde::kCellPixels - pixels);
    }
}

inline DensityLooks cell_density_plain(const kde::DensityTables& tables, const std::uint8_t* cell,
                                       const CellSamples& samples, const std::uint8_t* bandwidth_scale,
                                       int channels, int begin, bool may_stop, std::uint8_t* density) {
    if (begin == 0) std::memset(density, 0, kde::kCellPixels);
    for (int first = begin; first < samples.count; first += kde::kSamplesPerLook) {
        const int count = std::min(kde::kSamplesPerLook, samples.count - first);
        int unsure = 0;
        for (int lane = 0; lane < kde::kCellPixels; ++lane) {
            const int sum =
                density[lane] + kde::density(tables, cell + lane,
                                             samples.whole + first * channels * kde::kCellPixels + lane,
                                             bandwidth_scale + lane, count, channels);
            density[lane] = static_cast<std::uint8_t>(std::min(sum, 255));
            unsure += density[lane] < kde::kSureDensity;
        }
        if (may_stop && unsure < kde::kCandidatesPerCell) return {first + count, true};
    }
    return {samples.count, false};
}
}  // namespace kinevox::kernels::cpu
#endif  // KINEVOX_SEGMENTATION_DENSITY_PLAIN

#ifdef KINEVOX_HAVE_HIGHWAY
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/cpu/segmentation_density.cc"
#include <hwy/cache_control.h>
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace kinevox::kernels::cpu::HWY_NAMESPACE {
#if HWY_TARGET == HWY_SCALAR
// A processor without vectors of bytes: the shared scalar form.
template <int kChannels>
DensityLooks cell_density_of(const kde::DensityTables& tables, const std::uint8_t* cell,
                             const CellSamples& samples, const std::uint8_t* bandwidth_scale, int begin,
                             bool may_stop, const SamplesAhead&, std::uint8_t* density) {
    return cell_density_plain(tables, cell, samples, bandwidth_scale, kChannels, begin, may_stop, density);
}
void split_whole_cell(const std::uint8_t* interleaved, int channels, const std::uint16_t* gain_64,
                      std::uint8_t* cell) {
    split_plain(interleaved, kde::kCellPixels, channels, gain_64, cell);
}
#else
namespace hn = hwy::HWY_NAMESPACE;

using kde::kCellPixels;
// Never wider than a cell; scalable vectors are cut to it.
using Bytes = hn::CappedTag<std::uint8_t, kCellPixels>;
using Words = hn::Repartition<std::uint16_t, Bytes>;

// What the sums of one vector of pixels need besides the samples.
template <int kChannels>
struct PixelLanes {
    hn::Vec<Bytes> value[kChannels];
    hn::Vec<Words> scale_even[kChannels], scale_odd[kChannels];  // times 4, see add_sample()

    HWY_INLINE PixelLanes(const std::uint8_t* cell, const std::uint8_t* bandwidth_scale) {
        const Bytes bytes;
        const Words words;
        const auto low_byte = hn::Set(words, 0x00ff);
        for (int c = 0; c < kChannels; ++c) {
            value[c] = hn::Load(bytes, cell + c * kCellPixels);
            const auto scale = hn::BitCast(words, hn::Load(bytes, bandwidth_scale + c * kCellPixels));
            scale_even[c] = hn::ShiftLeft<2>(hn::And(scale, low_byte));
            scale_odd[c] = hn::ShiftLeft<2>(hn::ShiftRight<8>(scale));
        }
    }
};

template <int kChannels>
struct SampleLanes {
    hn::Vec<Bytes> value[kChannels];
};

template <int kChannels>
HWY_INLINE hn::Vec<Bytes> add_sample(const PixelLanes<kChannels>& pixels, hn::Vec<Bytes> squared_table,
                                     hn::Vec<Bytes> kernel_table, const SampleLanes<kChannels>& sample,
                                     hn::Vec<Bytes> sum) {
    const Bytes bytes;
    const Words words;
    const auto low_byte = hn::Set(words, 0x00ff);
    const auto fifteen = hn::Set(words, 15);
    auto squared = hn::Zero(bytes);
    for (int c = 0; c < kChannels; ++c) {
        const auto other = sample.value[c];
        const auto difference = hn::BitCast(words, hn::Or(hn::SaturatedSub(pixels.value[c], other),
                                                          hn::SaturatedSub(other, pixels.value[c])));
        // The high half of (difference << 8) * 4 * scale is difference * scale >> 6.
        const auto even = hn::Min(hn::MulHigh(hn::ShiftLeft<8>(difference), pixels.scale_even[c]), fifteen);
        const auto odd = hn::Min(hn::MulHigh(hn::AndNot(low_byte, difference), pixels.scale_odd[c]), fifteen);
        const auto index = hn::BitCast(bytes, hn::Or(even, hn::ShiftLeft<8>(odd)));
        squared = hn::SaturatedAdd(squared, hn::TableLookupBytes(squared_table, index));
    }
    const auto rounded = hn::BitCast(words, hn::SaturatedAdd(squared, hn::Set(bytes, 8)));
    const auto kernel_index = hn::And(hn::BitCast(bytes, hn::ShiftRight<4>(rounded)), hn::Set(bytes, 0x0f));
    return hn::SaturatedAdd(sum, hn::TableLookupBytes(kernel_table, kernel_index));
}

// Where a vector's samples come from, whole or packed; `lane` is its first pixel in the cell.
template <int kChannels>
class WholeSamples {
  public:
    HWY_INLINE WholeSamples(const CellSamples& samples, int lane) : samples_(samples.whole + lane) {}
    // Calls add(SampleLanes) for samples [first, last).
    template <class Add>
    HWY_INLINE void each(int first, int last, const Add& add) const {
        for (int i = first; i < last; ++i) {
            SampleLanes<kChannels> sample;
            for (int c = 0; c < kChannels; ++c)
                sample.value[c] = hn::Load(Bytes(), samples_ + (i * kChannels + c) * kCellPixels);
            add(sample);
        }
    }

  private:
    const std::uint8_t* samples_;
};

template <int kChannels>
class PackedPairs {
  public:
    HWY_INLINE PackedPairs(const CellSamples& samples, int lane)
        : pairs_(samples.packed + kChannels * kCellPixels + lane) {
        for (int c = 0; c < kChannels; ++c)
            lowest_[c] = hn::Load(Bytes(), samples.packed + c * kCellPixels + lane);
    }
    template <class Add>
    HWY_INLINE void each(int first, int last, const Add& add) const {
        const Bytes bytes;
        const auto half = hn::Set(bytes, 0x0f);
        for (int i = first; i < last; i += 2) {  // `first` is even
            SampleLanes<kChannels> even, odd;
            for (int c = 0; c < kChannels; ++c) {
                const auto pair = hn::Load(bytes, pairs_ + (i / 2 * kChannels + c) * kCellPixels);
                even.value[c] = hn::Add(lowest_[c], hn::And(pair, half));
                odd.value[c] = hn::Add(lowest_[c], hn::ShiftRight<4>(pair));
            }
            add(even);
            if (i + 1 < last) add(odd);
        }
    }

  private:
    const std::uint8_t* pairs_;
    hn::Vec<Bytes> lowest_[kChannels];
};

HWY_INLINE int unsure_lanes(hn::Vec<Bytes> sum) {
    const Bytes bytes;
    const auto reached = hn::Eq(hn::Max(sum, hn::Set(bytes, kde::kSureDensity)), sum);
    return static_cast<int>(hn::Lanes(bytes) - hn::CountTrue(bytes, reached));
}

template <int kChannels, template <int> class Samples>
HWY_INLINE DensityLooks sum_samples(const kde::DensityTables& tables, const std::uint8_t* cell,
                                    const CellSamples& samples, const std::uint8_t* bandwidth_scale,
                                    int begin, bool may_stop, const SamplesAhead& ahead,
                                    std::uint8_t* density) {
    static_assert(kde::kSamplesPerLook % 2 == 0);
    const Bytes bytes;
    const auto squared_table = hn::LoadDup128(bytes, tables.squared);
    const auto kernel_table = hn::LoadDup128(bytes, tables.kernel);
    // A few lines of the next cell with each sample of this one, as fast as memory delivers them.
    constexpr int kLineBytes = kChannels * kCellPixels;
    const std::uint8_t* coming = ahead.first;
    const std::uint8_t* const coming_end = coming + ahead.lines * kLineBytes;
    const auto fetch_line = [&] {
        if (coming == coming_end) return;
        for (int c = 0; c < kChannels; ++c) hwy::Prefetch(coming + c * kCellPixels);
        coming += kLineBytes;
    };
    DensityLooks looks{samples.count, false};
    if constexpr (hn::MaxLanes(bytes) == kCellPixels && !HWY_HAVE_SCALABLE) {
        const PixelLanes<kChannels> pixels(cell, bandwidth_scale);
        const Samples<kChannels> from(samples, 0);
        auto sum = begin == 0 ? hn::Zero(bytes) : hn::Load(bytes, density);
        for (int i = begin; i < samples.count;) {
            const int last = HWY_MIN(i + kde::kSamplesPerLook, samples.count);
            from.each(i, last, [&](const SampleLanes<kChannels>& sample) HWY_ATTR {
                fetch_line();
                sum = add_sample(pixels, squared_table, kernel_table, sample, sum);
            });
            i = last;
            if (may_stop && unsure_lanes(sum) < kde::kCandidatesPerCell) {
                looks = {last, true};
                break;
            }
            if (!may_stop && hn::AllTrue(bytes, hn::Eq(sum, hn::Set(bytes, 255))))
                break;  // no more can be added
        }
        hn::Store(sum, bytes, density);
    } else {
        const int lanes = static_cast<int>(hn::Lanes(bytes));
        if (begin == 0) std::memset(density, 0, kCellPixels);
        for (int first = begin; first < samples.count; first += kde::kSamplesPerLook) {
            const int last = HWY_MIN(first + kde::kSamplesPerLook, samples.count);
            int unsure = 0;
            for (int lane = 0; lane < kCellPixels; lane += lanes) {
                const PixelLanes<kChannels> pixels(cell + lane, bandwidth_scale + lane);
                const Samples<kChannels> from(samples, lane);
                auto sum = hn::Load(bytes, density + lane);
                from.each(first, last, [&](const SampleLanes<kChannels>& sample) HWY_ATTR {
                    if (lane == 0) fetch_line();
                    sum = add_sample(pixels, squared_table, kernel_table, sample, sum);
                });
                hn::Store(sum, bytes, density + lane);
                unsure += unsure_lanes(sum);
            }
            if (may_stop && unsure < kde::kCandidatesPerCell) {
                looks = {last, true};
                break;
            }
        }
    }
    while (coming != coming_end) fetch_line();
    return looks;
}

template <int kChannels>
DensityLooks cell_density_of(const kde::DensityTables& tables, const std::uint8_t* cell,
                             const CellSamples& samples, const std::uint8_t* bandwidth_scale, int begin,
                             bool may_stop, const SamplesAhead& ahead, std::uint8_t* density) {
    return samples.packed ? sum_samples<kChannels, PackedPairs>(tables, cell, samples, bandwidth_scale, begin,
                                                                may_stop, ahead, density)
                          : sum_samples<kChannels, WholeSamples>(tables, cell, samples, bandwidth_scale,
                                                                 begin, may_stop, ahead, density);
}

// One plane: value * gain / 16384 in 1/64 levels, rounded.
HWY_INLINE hn::Vec<Bytes> with_gain(Bytes bytes, hn::Vec<Bytes> value, std::uint16_t gain_64) {
    const Words words;
    const auto low_byte = hn::Set(words, 0x00ff);
    const auto gain = hn::Set(words, gain_64);
    const auto half = hn::Set(words, 32);
    const auto top = hn::Set(words, 255);
    const auto v = hn::BitCast(words, value);
    const auto scaled = [&](auto shifted) {
        return hn::Min(hn::ShiftRight<6>(hn::SaturatedAdd(hn::MulHigh(shifted, gain), half)), top);
    };
    const auto even = scaled(hn::ShiftLeft<8>(v));
    const auto odd = scaled(hn::AndNot(low_byte, v));
    const auto result = hn::BitCast(bytes, hn::Or(even, hn::ShiftLeft<8>(odd)));
    const auto clipped = hn::Eq(hn::Max(value, hn::Set(bytes, 253)), value);
    return hn::IfThenElse(clipped, hn::Set(bytes, 255), result);
}

void split_whole_cell(const std::uint8_t* interleaved, int channels, const std::uint16_t* gain_64,
                      std::uint8_t* cell) {
    const Bytes bytes;
    for (int lane = 0; lane < kCellPixels; lane += static_cast<int>(hn::Lanes(bytes))) {
        if (channels == 1) {
            hn::Store(with_gain(bytes, hn::LoadU(bytes, interleaved + lane), gain_64[0]), bytes, cell + lane);
            continue;
        }
        hn::Vec<Bytes> b, g, r;
        hn::LoadInterleaved3(bytes, interleaved + 3 * lane, b, g, r);
        hn::Store(with_gain(bytes, b, gain_64[0]), bytes, cell + lane);
        hn::Store(with_gain(bytes, g, gain_64[1]), bytes, cell + kCellPixels + lane);
        hn::Store(with_gain(bytes, r, gain_64[2]), bytes, cell + 2 * kCellPixels + lane);
    }
}

#endif  // HWY_SCALAR

DensityLooks cell_density_1(const kde::DensityTables& tables, const std::uint8_t* cell,
                            const CellSamples& samples, const std::uint8_t* bandwidth_scale, int begin,
                            bool may_stop, const SamplesAhead& ahead, std::uint8_t* density) {
    return cell_density_of<1>(tables, cell, samples, bandwidth_scale, begin, may_stop, ahead, density);
}
DensityLooks cell_density_3(const kde::DensityTables& tables, const std::uint8_t* cell,
                            const CellSamples& samples, const std::uint8_t* bandwidth_scale, int begin,
                            bool may_stop, const SamplesAhead& ahead, std::uint8_t* density) {
    return cell_density_of<3>(tables, cell, samples, bandwidth_scale, begin, may_stop, ahead, density);
}

}  // namespace kinevox::kernels::cpu::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif  // KINEVOX_HAVE_HIGHWAY

#if !defined(KINEVOX_HAVE_HIGHWAY) || HWY_ONCE
namespace kinevox::kernels::cpu {

using kde::kCellPixels;

#ifdef KINEVOX_HAVE_HIGHWAY
HWY_EXPORT(cell_density_1);
HWY_EXPORT(cell_density_3);
HWY_EXPORT(split_whole_cell);
#endif

kde::DensityTables make_density_tables(int sample_count) {
    kde::DensityTables tables{};
    for (int i = 0; i < 16; ++i)
        tables.squared[i] = static_cast<std::uint8_t>(i == 0    ? 0
                                                      : i == 15 ? 255
                                                                : std::lround((i + 0.5) * (i + 0.5)));
    const double peak = 255.0 / (kde::saturation(sample_count) * sample_count);
    for (int i = 0; i < 15; ++i)
        tables.kernel[i] = static_cast<std::uint8_t>(std::lround(peak * std::exp(-0.5 * i)));
    return tables;
}

void split_cell(const std::uint8_t* interleaved, int pixels, int channels, const std::uint16_t* gain_64,
                std::uint8_t* cell) {
#ifdef KINEVOX_HAVE_HIGHWAY
    if (pixels == kCellPixels) {
        HWY_DYNAMIC_DISPATCH(split_whole_cell)(interleaved, channels, gain_64, cell);
        return;
    }
#endif
    split_plain(interleaved, pixels, channels, gain_64, cell);
}

DensityLooks cell_density(const kde::DensityTables& tables, const std::uint8_t* cell,
                          const CellSamples& samples, const std::uint8_t* bandwidth_scale, int channels,
                          int begin, bool may_stop, std::uint8_t* density, const SamplesAhead& ahead) {
#ifdef KINEVOX_HAVE_HIGHWAY
    return channels == 1 ? HWY_DYNAMIC_DISPATCH(cell_density_1)(tables, cell, samples, bandwidth_scale, begin,
                                                                may_stop, ahead, density)
                         : HWY_DYNAMIC_DISPATCH(cell_density_3)(tables, cell, samples, bandwidth_scale, begin,
                                                                may_stop, ahead, density);
#else
    static_cast<void>(ahead);
    return cell_density_plain(tables, cell, samples, bandwidth_scale, channels, begin, may_stop, density);
#endif
}

}  // namespace kinevox::kernels::cpu
#endif
