#include "kernels/stages.h"

#include <mutex>

#include "kernels/cuda/forms.h"

namespace kinevox::kernels {
namespace {

class DeviceStages final : public StageFactory {
  public:
    explicit DeviceStages(Device device) : device_(device) {}

    std::unique_ptr<Segmenter> segmenter(int width, int height, int channels,
                                         const SegmentationOptions& options) const override {
        return make_segmenter(device_, width, height, channels, options, context());
    }
    std::unique_ptr<RewindableSegmenter> rewindable_segmenter(
        int width, int height, int channels, const SegmentationOptions& options) const override {
        return make_rewindable_segmenter(device_, width, height, channels, options, context());
    }
    std::unique_ptr<HullCarver> hull_carver(const HullOptions& options) const override {
        return make_hull_carver(device_, options);
    }
    std::unique_ptr<VoxelColourer> voxel_colourer(const ColouringOptions& options) const override {
        return make_voxel_colourer(device_, options);
    }

    Device device() const override { return device_; }
    std::string problem() const override {
        if (!device_.is_cuda()) return {};
#ifdef KINEVOX_HAVE_CUDA
        return cuda_problem(device_.index());
#else
        return "this program was built without a CUDA compiler";
#endif
    }
    std::string name() const override {
#ifdef KINEVOX_HAVE_CUDA
        if (device_.is_cuda()) return cuda_device_name(device_.index());
#endif
        return {};
    }
    DeviceMemory memory() const override {
#ifdef KINEVOX_HAVE_CUDA
        if (device_.is_cuda()) return cuda_memory(device_.index());
#endif
        return {};
    }

  private:
    // Of all its segmenters; null on the CPU. Made when it is first needed: a factory also exists where the
    // GPU cannot be used.
    std::shared_ptr<DeviceContext> context() const {
#ifdef KINEVOX_HAVE_CUDA
        const std::lock_guard lock(mutex_);
        if (device_.is_cuda() && !context_) context_ = make_device_context_cuda(device_.index());
        return context_;
#else
        return nullptr;
#endif
    }

    const Device device_;
    mutable std::mutex mutex_;
    mutable std::shared_ptr<DeviceContext> context_;
};

}  // namespace

std::unique_ptr<StageFactory> make_stage_factory(Device device) {
    return std::make_unique<DeviceStages>(device);
}

}  // namespace kinevox::kernels
