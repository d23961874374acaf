// Pseudo-Zernike moments of a silhouette (paper, section 4; Teh & Chin, On image analysis by the methods of
// moments, PAMI 10, 1988):
//   P_pq = (p + 1) / pi * integral over the unit disk of f * conj(W_pq),  W_pq = R_pq(r) e^(i q theta)
// f is 0 outside of the silhouette, 1 inside, in between where a mask's value is. theta runs from the
// image's x (right) to its y (down).
//
// Mapping to the unit disk. The disk's centre lies in the silhouette's centre of gravity and its radius is
// `disk_per_gyration` times the root mean square distance of the silhouette's area from there. That measure,
// unlike the farthest pixel, hardly moves when a hand is lost or a speck appears. What lies outside of the
// disk is cut off: at the default of 2.5 only a straight thin limb far from a compact body extends so far (a
// bar ends at 1.73, a standing person's soles are at 2.1). So moments do not depend on position and size. A
// caller who knows the size from elsewhere gives the mapping instead.
//
// The mask is averaged over a fixed grid of square cells in the disk's square (each pixel counts with the
// area that it shares with a cell), and each cell's value is multiplied with the basis function's integral
// over that cell.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "kernels/types.h"

namespace kinevox::kernels {

inline constexpr int kMaxMomentOrder = 20;

// Moments are stored as real numbers by order, so that a lower order is the beginning of a higher one: for p
// the 2 p + 1 numbers Re P_p0, Re P_p1, Im P_p1, .., Re P_pp, Im P_pp. P_p,-q is the conjugate of P_pq.
inline constexpr int moment_values(int order) {
    return (order + 1) * (order + 1);
}
inline constexpr int moment_re_index(int p, int q) {
    return p * p + (q == 0 ? 0 : 2 * q - 1);
}
inline constexpr int moment_im_index(int p, int q) {
    return p * p + 2 * q;
}  // q > 0

struct MomentOptions {
    int order = 10;                  // highest p, 0 to kMaxMomentOrder
    int grid = 64;                   // cells along the disk's diameter, a multiple of 16 from 16 to 256
    float disk_per_gyration = 2.5f;  // see above, 1 to 10

    std::string check() const;
};

// x_disk = (x_px - centre) / radius.
struct DiskMapping {
    float centre_x_px = 0, centre_y_px = 0;
    float radius_px = 0;
};

// A non-owning view of a mask; 0..255 per pixel, only pixels inside `bounds` are read.
struct MomentView {
    const std::uint8_t* mask = nullptr;  // null: no silhouette
    std::ptrdiff_t stride = 0;           // bytes from one row to the next
    Rect bounds;                         // px, a box around the silhouette
    std::optional<DiskMapping> mapping;  // from the silhouette itself if absent
    float radius_px = 0;  // without a mapping: the centre from the silhouette, this radius; 0: both
};

struct SilhouetteMoments {
    double mass_px = 0;  // area, px^2; 0: there is nothing, then all values are 0 and so is the radius
    DiskMapping mapping;
    std::vector<float> values;  // moment_values(order)
};

// Not thread-safe; keeps its working memory from call to call. The same mask gives the same bits, independent
// of the other views and the number of threads.
class MomentCalculator {
  public:
    virtual ~MomentCalculator() = default;
    virtual void compute(std::span<const MomentView> views, std::vector<SilhouetteMoments>& out) = 0;
};

// Throws std::invalid_argument where options.check() is not empty, std::runtime_error where the device is
// absent.
std::unique_ptr<MomentCalculator> make_moment_calculator(Device device, const MomentOptions& options = {});

// R_pq(r) for q <= p <= order by the recurrence over p that Jacobi's polynomials obey; r in [0, 1]. `out` has
// order - q + 1 entries, for p = q, q + 1, ...
void pseudo_zernike_radial(int q, int order, double r, double* out);

// Scales moments so that the sum of squared differences of two vectors is the squared difference of the two
// silhouettes over the disk, as far as this order resolves it: what a nearest neighbour should mean.
void moment_orthonormal_scale(int order, float* scale);

}  // namespace kinevox::kernels
