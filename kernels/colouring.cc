#include "kernels/colouring.h"

#include <stdexcept>
#include <string>

#include "kernels/cpu/colouring.h"
#include "kernels/cuda/forms.h"

namespace kinevox::kernels {

std::string ColouringOptions::check() const {
    if (max_rounds < 0 || max_rounds > 1000) {
        return "colouring.max_rounds is " + std::to_string(max_rounds) + "; 0 to 1000 is allowed";
    }
    const auto within = [](float value, float low, float high) { return value >= low && value <= high; };
    const auto say = [](const char* name, float value, const char* allowed) {
        return std::string("colouring.") + name + " is " + std::to_string(value) + "; " + allowed +
               " is allowed";
    };
    if (!within(sharp_budget_permille, -1e6f, 50)) {
        return say("sharp_budget_permille", sharp_budget_permille,
                   "up to 50, or a negative number for never,");
    }
    if (!within(fill_radius_m, 0, 1)) return say("fill_radius_m", fill_radius_m, "0 to 1 m");
    if (!within(max_colour_difference_std, 0, 1000))
        return say("max_colour_difference_std", max_colour_difference_std, "0 to 1000");
    if (!within(noise_grey, 0.1f, 255)) return say("noise_grey", noise_grey, "0.1 to 255");
    if (!within(support_edge_m, 0, 1)) return say("support_edge_m", support_edge_m, "0 to 1 m");
    if (!within(min_support, 0, 0.5f)) return say("min_support", min_support, "0 to 0.5");
    if (!within(min_ray_length_m, 0, 1)) return say("min_ray_length_m", min_ray_length_m, "0 to 1 m");
    return {};
}

void VoxelColourer::carve_and_colour(HullCarver& carver, std::span<const HullView> hull_views,
                                     const Lattice& lattice, std::span<const ColouringView> views,
                                     VoxelVolume& volume, ColouringReport& report) {
    carver.carve(hull_views, lattice, volume);
    colour(views, volume, report);
}

std::unique_ptr<VoxelColourer> make_voxel_colourer(Device device, const ColouringOptions& options) {
    if (const std::string problem = options.check(); !problem.empty()) throw std::invalid_argument(problem);
    if (device.is_cuda()) {
#ifdef KINEVOX_HAVE_CUDA
        return make_voxel_colourer_cuda(device.index(), options);
#else
        throw std::runtime_error(
            "colouring: built without a CUDA compiler; build where nvcc is found, or use device cpu");
#endif
    }
    return make_voxel_colourer_cpu(options);
}

}  // namespace kinevox::kernels
