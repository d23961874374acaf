// How one pixel of the background model takes a new value.
#pragma once

#include <cstdint>

#include "kernels/shared/device.h"
#include "kernels/shared/kde_density.h"

namespace kinevox::kernels::kde {

// From this density() on a pixel is background enough to be learned from. A sum that ended early says so too.
inline constexpr int kLearnDensity = kSureDensity;

struct UpdateParameters {
    int sample_count = 32;
    int short_term_begin = 24;  // slots [short_term_begin, sample_count) are short-term memory
    int short_term_slot = 24;   // the slot that takes this value
    int long_term_slot = -1;    // the same for the long-term memory, or -1
    int absorb_visits = 37;     // visits for which something new must stay, 1..255
    int max_scale = 170;        // 256 / the smallest bandwidth
};

struct PixelModel {
    std::uint8_t* samples;    // of this pixel: [sample][channel], kCellPixels bytes apart
    std::uint8_t* scale;      // [channel]
    std::uint8_t* reference;  // [channel]
    std::uint8_t* candidate;  // [channel]
    std::uint8_t* visits;
};

// The bandwidth follows the median of the consecutive differences (0.954 bandwidths for Gaussian noise) by
// steps.
KINEVOX_HD inline std::uint8_t stepped_scale(int scale, int value, int previous, int max_scale) {
    const int difference = value > previous ? value - previous : previous - value;
    const int stepped = difference * scale > 244 ? scale - 1 : scale + 1;
    const int bounded = stepped < max_scale ? stepped : max_scale;
    return static_cast<std::uint8_t>(bounded > 8 ? bounded : 8);
}

// A sixteenth of the way, rounded away from staying: a difference of eight levels or less moves by one a
// visit.
KINEVOX_HD inline std::uint8_t stepped_reference(int reference, int value) {
    const int step = value - reference;
    const int magnitude = step < 0 ? -step : step;
    const int moved = magnitude < 3 ? 0 : (magnitude + 15) >> 4;
    return static_cast<std::uint8_t>(step < 0 ? reference - moved : reference + moved);
}

// The short-term slot that was filled before this one.
KINEVOX_HD inline int previous_slot(const UpdateParameters& p) {
    return p.short_term_slot > p.short_term_begin ? p.short_term_slot - 1 : p.sample_count - 1;
}

KINEVOX_HD inline std::uint8_t& sample_of(const PixelModel& m, int slot, int channel, int channels) {
    return m.samples[(slot * channels + channel) * kCellPixels];
}

// A value that is background.
KINEVOX_HD inline void learn_background_value(const std::uint8_t* value, int channels,
                                              const UpdateParameters& p, const PixelModel& m) {
    for (int c = 0; c < channels; ++c) {
        const int at = c * kCellPixels;
        if (p.sample_count > 1)
            m.scale[at] = stepped_scale(m.scale[at], value[at], sample_of(m, previous_slot(p), c, channels),
                                        p.max_scale);
        m.reference[at] = stepped_reference(m.reference[at], value[at]);
        sample_of(m, p.short_term_slot, c, channels) = value[at];
        if (p.long_term_slot >= 0) sample_of(m, p.long_term_slot, c, channels) = value[at];
    }
}

// A value that is neither background nor the subject: once it has stayed for long enough it fills the
// short-term memory. The long-term memory still knows what was there before.
KINEVOX_HD inline void watch_strange_value(const std::uint8_t* value, int channels, const UpdateParameters& p,
                                           const PixelModel& m) {
    bool same = *m.visits > 0;
    for (int c = 0; c < channels; ++c) {
        const int at = c * kCellPixels;
        const int difference =
            value[at] > m.candidate[at] ? value[at] - m.candidate[at] : m.candidate[at] - value[at];
        same = same && difference * m.scale[at] <= 3 * 256 + 2 * m.scale[at];
    }
    if (!same) {
        *m.visits = 1;
        for (int c = 0; c < channels; ++c) m.candidate[c * kCellPixels] = value[c * kCellPixels];
        return;
    }
    if (++*m.visits < p.absorb_visits) return;
    *m.visits = 0;
    for (int c = 0; c < channels; ++c) {
        const int at = c * kCellPixels;
        for (int slot = p.short_term_begin; slot < p.sample_count; ++slot)
            sample_of(m, slot, c, channels) = slot % 2 ? value[at] : m.candidate[at];
        m.reference[at] = value[at];
    }
}

}  // namespace kinevox::kernels::kde
