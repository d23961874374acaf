#include "kernels/moments.h"

#include <cmath>
#include <numbers>
#include <stdexcept>

#include "kernels/cpu/moments.h"
#include "kernels/cuda/forms.h"

namespace kinevox::kernels {

std::string MomentOptions::check() const {
    if (order < 0 || order > kMaxMomentOrder)
        return "moments.order is " + std::to_string(order) + "; 0 to " + std::to_string(kMaxMomentOrder) +
               " is allowed";
    if (grid < 16 || grid > 256 || grid % 16 != 0)
        return "moments.grid is " + std::to_string(grid) + "; a multiple of 16 from 16 to 256 is needed";
    if (!(disk_per_gyration >= 1 && disk_per_gyration <= 10))
        return "moments.disk_per_gyration is " + std::to_string(disk_per_gyration) + "; 1 to 10 is allowed";
    return {};
}

std::unique_ptr<MomentCalculator> make_moment_calculator(Device device, const MomentOptions& options) {
    if (const std::string problem = options.check(); !problem.empty()) throw std::invalid_argument(problem);
    if (device == Device::kCuda) {
#ifdef KINEVOX_HAVE_CUDA
        return make_moment_calculator_cuda(options);
#else
        throw std::runtime_error(
            "moments: built without a CUDA compiler; build where nvcc is found, or use device cpu");
#endif
    }
    return make_moment_calculator_cpu(options);
}

// R_pq(r) = r^q J_n(2 r - 1) with n = p - q and J_n Jacobi's polynomial P_n^(0, 2q+1): both are orthogonal on
// [0, 1] with the weight r and are 1 at r = 1. Its three-term recurrence never cancels there, unlike the sum
// with factorials.
void pseudo_zernike_radial(int q, int order, double r, double* out) {
    const double b = 2.0 * q + 1, x = 2 * r - 1;
    double power = 1;
    for (int n = 0; n < q; ++n) power *= r;
    double before = 0, now = power;
    for (int n = 0; n <= order - q; ++n) {
        out[n] = now;
        const double m = n + 1, s = 2 * m + b;
        const double next =
            n == 0 ? power * (1 + 0.5 * (b + 2) * (x - 1))
                   : ((s - 1) * (s * (s - 2) * x - b * b) * now - 2 * (m - 1) * (m + b - 1) * s * before) /
                         (2 * m * (m + b) * (s - 2));
        before = now;
        now = next;
    }
}

void moment_orthonormal_scale(int order, float* scale) {
    for (int p = 0; p <= order; ++p) {
        scale[moment_re_index(p, 0)] = static_cast<float>(std::sqrt(std::numbers::pi / (p + 1)));
        for (int q = 1; q <= p; ++q)  // stands for -q too
            scale[moment_re_index(p, q)] = scale[moment_im_index(p, q)] =
                static_cast<float>(std::sqrt(2 * std::numbers::pi / (p + 1)));
    }
}

}  // namespace kinevox::kernels
