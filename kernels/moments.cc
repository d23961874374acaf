#include "kernels/moments.h"

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
    if (device.is_cuda()) {
#ifdef KINEVOX_HAVE_CUDA
        return make_moment_calculator_cuda(device.index(), options);
#else
        throw std::runtime_error(
            "moments: built without a CUDA compiler; build where nvcc is found, or use device cpu");
#endif
    }
    return make_moment_calculator_cpu(options);
}

}  // namespace kinevox::kernels
