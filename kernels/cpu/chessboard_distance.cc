#include "kernels/cpu/chessboard_distance.h"

#include <algorithm>
#include <cstddef>
#include <cstring>

#include "kernels/cpu/dispatch.h"

#ifdef KINEVOX_HAVE_HIGHWAY
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "kernels/cpu/chessboard_distance.cc"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>
HWY_BEFORE_NAMESPACE();
#endif

namespace kinevox::kernels::HWY_NAMESPACE {

constexpr int kLanes = 16;  // what rows are padded to, at both sides

// One pass over a row of `padded` cells (a multiple of kLanes), `ahead` being the row that the pass came
// from. First from that row, then along the row: backwards where `kBackwards`. `rim`: what lies beside the
// row.
#if defined(KINEVOX_HAVE_HIGHWAY) && HWY_TARGET != HWY_SCALAR
namespace hn = hwy::HWY_NAMESPACE;
using Cells = hn::FixedTag<std::uint8_t, kLanes>;
using V = hn::Vec<Cells>;

// The cells `kStep` before each, or behind it where kBackwards; no nearer than anything where there is none.
template <bool kBackwards, int kStep>
HWY_INLINE V moved(V v, V far) {
    if constexpr (kBackwards) return hn::CombineShiftRightBytes<kStep>(Cells(), far, v);
    return hn::CombineShiftRightBytes<kLanes - kStep>(Cells(), v, far);
}

template <bool kBackwards>
HWY_INLINE void relax_row(const std::uint8_t* ahead, int padded, int rim, std::uint8_t* row) {
    const Cells d;
    const V one = hn::Set(d, 1), far = hn::Set(d, 255);
    alignas(kLanes) std::uint8_t steps[kLanes];
    for (int i = 0; i < kLanes; ++i) steps[i] = static_cast<std::uint8_t>(kBackwards ? kLanes - i : i + 1);
    const V from_carry = hn::Load(d, steps);
    int carry = rim;
    for (int n = 0; n < padded; n += kLanes) {
        const int x = kBackwards ? padded - kLanes - n : n;
        const V above = hn::Min(hn::Min(hn::LoadU(d, ahead + x - 1), hn::LoadU(d, ahead + x)),
                                hn::LoadU(d, ahead + x + 1));
        V v = hn::Min(hn::LoadU(d, row + x), hn::SaturatedAdd(above, one));
        v = hn::Min(v, hn::SaturatedAdd(moved<kBackwards, 1>(v, far), one));
        v = hn::Min(v, hn::SaturatedAdd(moved<kBackwards, 2>(v, far), hn::Set(d, 2)));
        v = hn::Min(v, hn::SaturatedAdd(moved<kBackwards, 4>(v, far), hn::Set(d, 4)));
        v = hn::Min(v, hn::SaturatedAdd(moved<kBackwards, 8>(v, far), hn::Set(d, 8)));
        v = hn::Min(v, hn::SaturatedAdd(hn::Set(d, static_cast<std::uint8_t>(carry)), from_carry));
        hn::StoreU(v, d, row + x);
        carry = row[kBackwards ? x : x + kLanes - 1];
    }
}
#else
template <bool kBackwards>
void relax_row(const std::uint8_t* ahead, int padded, int rim, std::uint8_t* row) {
    int nearest = rim;
    for (int n = 0; n < padded; ++n) {
        const int x = kBackwards ? padded - 1 - n : n;
        const int above = std::min({ahead[x - 1], ahead[x], ahead[x + 1]});
        nearest = std::min({nearest + 1, above + 1, static_cast<int>(row[x])});
        row[x] = static_cast<std::uint8_t>(nearest);
    }
}
#endif

// Beyond the width the rows are padded as if the image continued, which changes nothing inside: no path
// around is shorter.
void transform(int width, int height, const std::uint8_t* kind, std::vector<std::uint8_t>& scratch,
               std::int8_t* out) {
    constexpr int kFar = 127;
    const int padded = (width + kLanes - 1) / kLanes * kLanes, stride = padded + 2 * kLanes;
    const std::size_t plane = static_cast<std::size_t>(stride) * (height + 2);
    scratch.resize(2 * plane);
    const auto fore_row = [&](int y) {
        return scratch.data() + static_cast<std::ptrdiff_t>(y + 1) * stride + kLanes;
    };
    const auto back_row = [&](int y) { return fore_row(y) + plane; };
    std::memset(scratch.data(), kFar, plane);
    std::memset(scratch.data() + plane, 0, plane);
    for (int y = 0; y < height; ++y) {
        std::uint8_t *fore = fore_row(y), *back = back_row(y);
        const std::uint8_t* row = kind + static_cast<std::size_t>(y) * width;
#pragma GCC ivdep
        for (int x = 0; x < width; ++x) {
            fore[x] = row[x] & 1 ? 0 : kFar;
            back[x] = row[x] & 2 ? 0 : kFar;
        }
        relax_row<false>(fore_row(y - 1), padded, kFar, fore);
        relax_row<false>(back_row(y - 1), padded, 0, back);
    }
    for (int y = height - 1; y >= 0; --y) {
        std::uint8_t *fore = fore_row(y), *back = back_row(y);
        relax_row<true>(fore_row(y + 1), padded, kFar, fore);
        relax_row<true>(back_row(y + 1), padded, 0, back);
        std::int8_t* row = out + static_cast<std::size_t>(y) * width;
#pragma GCC ivdep
        for (int x = 0; x < width; ++x) row[x] = static_cast<std::int8_t>(fore[x] - back[x]);
    }
}

}  // namespace kinevox::kernels::HWY_NAMESPACE

#ifdef KINEVOX_HAVE_HIGHWAY
HWY_AFTER_NAMESPACE();
#endif

#if !defined(KINEVOX_HAVE_HIGHWAY) || HWY_ONCE
namespace kinevox::kernels {
KINEVOX_EXPORT(transform);

void chessboard_distances(int width, int height, const std::uint8_t* kind, std::vector<std::uint8_t>& scratch,
                          std::int8_t* out) {
    KINEVOX_DISPATCH(transform)(width, height, kind, scratch, out);
}
}  // namespace kinevox::kernels
#endif
