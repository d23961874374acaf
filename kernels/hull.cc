#include "kernels/hull.h"

#include <stdexcept>
#include <string>

#include "kernels/cpu/hull.h"
#include "kernels/cuda/forms.h"

namespace kinevox::kernels {

std::string HullOptions::check() const {
    if (min_views < 1) return "hull.min_views is " + std::to_string(min_views) + "; at least 1 is needed";
    if (!(miss_budget_permille >= 0 && miss_budget_permille <= 50)) {
        return "hull.miss_budget_permille is " + std::to_string(miss_budget_permille) +
               "; 0 to 50 is allowed";
    }
    if (!(fill_radius_m >= 0 && fill_radius_m <= 1)) {
        return "hull.fill_radius_m is " + std::to_string(fill_radius_m) + "; 0 to 1 m is allowed";
    }
    return {};
}

std::unique_ptr<HullCarver> make_hull_carver(Device device, const HullOptions& options) {
    if (const std::string problem = options.check(); !problem.empty()) throw std::invalid_argument(problem);
    if (device.is_cuda()) {
#ifdef KINEVOX_HAVE_CUDA
        return make_hull_carver_cuda(device.index(), options);
#else
        throw std::runtime_error(
            "hull: built without a CUDA compiler; build where nvcc is found, or use device cpu");
#endif
    }
    return make_hull_carver_cpu(options);
}

}  // namespace kinevox::kernels
