// Voxel colouring on the device.
#include "kernels/cpu/colouring.h"
#include "kernels/cuda/device.h"
#include "kernels/cuda/forms.h"
#include "kernels/cuda/volume_maker.h"

namespace kinevox::kernels {
namespace cuda {
namespace {

class CudaVoxelColourer final : public VoxelColourer {
  public:
    explicit CudaVoxelColourer(const ColouringOptions& options)
        : options_(options), cpu_(make_voxel_colourer_cpu(options)) {}

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

  private:
    ColouringOptions options_;
    std::unique_ptr<VoxelColourer> cpu_;  // for what is empty
    VolumeMaker maker_;
};

}  // namespace
}  // namespace cuda

std::unique_ptr<VoxelColourer> make_voxel_colourer_cuda(const ColouringOptions& options) {
    cuda::require_gpu("colouring");
    return std::make_unique<cuda::CudaVoxelColourer>(options);
}

}  // namespace kinevox::kernels
