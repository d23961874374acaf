// The carver on the device; the host only sees the finished bricks, already in order.
#include "kernels/cpu/hull.h"
#include "kernels/cuda/device.h"
#include "kernels/cuda/forms.h"
#include "kernels/cuda/hull.h"
#include "kernels/cuda/volume_maker.h"

namespace kinevox::kernels {
namespace cuda {
namespace {

class CudaHullCarver final : public HullCarver {
  public:
    CudaHullCarver(int gpu, const HullOptions& options) : options_(options), maker_(gpu) {}

    void carve(std::span<const HullView> views, const Lattice& lattice, VoxelVolume& out) override {
        check_lattice(lattice);
        out.lattice = lattice;
        out.bricks.clear();
        out.colours.clear();
        if (hull_silhouettes(views, lattice, options_.miss_budget_permille).empty())
            return;  // no view votes, and at least one must contain a voxel
        VolumeRequest request;
        request.lattice = lattice;
        request.hull = &options_;
        request.hull_views = views;
        ColouringReport report;
        maker_.make(request, out, report);
    }

    const HullOptions& options() const { return options_; }

  private:
    HullOptions options_;
    VolumeMaker maker_;
};

}  // namespace

const HullOptions* options_of(const HullCarver& carver) {
    const auto* const own = dynamic_cast<const CudaHullCarver*>(&carver);
    return own ? &own->options() : nullptr;
}

}  // namespace cuda

std::unique_ptr<HullCarver> make_hull_carver_cuda(int gpu, const HullOptions& options) {
    cuda::require_gpu("hull", gpu);
    return std::make_unique<cuda::CudaHullCarver>(gpu, options);
}

}  // namespace kinevox::kernels
