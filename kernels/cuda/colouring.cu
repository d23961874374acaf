// Voxel colouring on the device.
#include "kernels/cpu/colouring.h"
#include "kernels/cpu/hull.h"
#include "kernels/cuda/device.h"
#include "kernels/cuda/forms.h"
#include "kernels/cuda/hull.h"
#include "kernels/cuda/volume_maker.h"

namespace kinevox::kernels {
namespace cuda {
namespace {

class CudaVoxelColourer final : public VoxelColourer {
  public:
    CudaVoxelColourer(int gpu, const ColouringOptions& options)
        : options_(options), cpu_(make_voxel_colourer_cpu(options)), maker_(gpu) {}

    void colour(std::span<const ColouringView> views, VoxelVolume& volume, ColouringReport& report) override {
        check_colouring_views(views);
        if (views.empty() || volume.bricks.empty()) return cpu_->colour(views, volume, report);
        VolumeRequest request;
        request.lattice = volume.lattice;
        request.given = volume.bricks;
        request.colouring = &options_;
        request.views = views;
        maker_.make(request, volume, report);
    }

    bool carves_and_colours() const override { return true; }
    void carve_and_colour(HullCarver& carver, std::span<const HullView> hull_views, const Lattice& lattice,
                          std::span<const ColouringView> views, VoxelVolume& volume,
                          ColouringReport& report) override {
        check_lattice(lattice);
        check_colouring_views(views);
        const HullOptions* const hull = options_of(carver);
        if (!hull || views.empty() ||
            hull_silhouettes(hull_views, lattice, hull->miss_budget_permille).empty())
            return VoxelColourer::carve_and_colour(carver, hull_views, lattice, views, volume, report);
        VolumeRequest request;
        request.lattice = lattice;
        request.hull = hull;
        request.hull_views = hull_views;
        request.colouring = &options_;
        request.views = views;
        maker_.make(request, volume, report);
    }

  private:
    ColouringOptions options_;
    std::unique_ptr<VoxelColourer> cpu_;  // for what is empty
    VolumeMaker maker_;
};

}  // namespace
}  // namespace cuda

std::unique_ptr<VoxelColourer> make_voxel_colourer_cuda(int gpu, const ColouringOptions& options) {
    cuda::require_gpu("colouring", gpu);
    return std::make_unique<cuda::CudaVoxelColourer>(gpu, options);
}

}  // namespace kinevox::kernels
