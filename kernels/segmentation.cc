#include "kernels/segmentation.h"

#include <stdexcept>
#include <string>
#include <utility>

#include "kernels/cpu/segmentation_model.h"
#include "kernels/cuda/forms.h"
#include "kernels/segmentation_memory.h"

namespace kinevox::kernels {

std::string SegmentationOptions::check() const {
    if (std::string problem = check_ranges(*this); !problem.empty()) return problem;
    if (loose_threshold > sharp_threshold) return "loose_threshold is above sharp_threshold; it must not be";
    return "";
}

std::unique_ptr<Segmenter> make_segmenter(Device device, int width, int height, int channels,
                                          const SegmentationOptions& options,
                                          [[maybe_unused]] std::shared_ptr<DeviceContext> context) {
    if (const std::string problem = options.check(); !problem.empty())
        throw std::invalid_argument("segmentation options: " + problem);
    if (width < 1 || height < 1 || (channels != 1 && channels != 3))
        throw std::invalid_argument("segmentation: images of " + std::to_string(width) + " x " +
                                    std::to_string(height) + " with " + std::to_string(channels) +
                                    " channels; sizes are positive and channels 1 or 3");
    if (device.is_cuda()) {
#ifdef KINEVOX_HAVE_CUDA
        return make_segmenter_cuda(device.index(), width, height, channels, options,
                                   context ? std::move(context) : make_device_context_cuda(device.index()));
#else
        throw std::runtime_error(
            "segmentation: built without a CUDA compiler; build where nvcc is found, or use "
            "device cpu");
#endif
    }
    return make_segmenter_cpu(width, height, channels, options);
}

std::unique_ptr<RewindableSegmenter> make_rewindable_segmenter(Device device, int width, int height,
                                                               int channels,
                                                               const SegmentationOptions& options,
                                                               std::shared_ptr<DeviceContext> context) {
    std::unique_ptr<Segmenter> made =
        make_segmenter(device, width, height, channels, options, std::move(context));
    auto* const segmenter = dynamic_cast<RewindableSegmenter*>(made.get());  // both forms are
    if (!segmenter) throw std::logic_error("segmentation: the segmenter of this device cannot be rewound");
    made.release();
    segmenter->keep_learned();
    return std::unique_ptr<RewindableSegmenter>(segmenter);
}

}  // namespace kinevox::kernels
