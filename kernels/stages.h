// The stages of one device, for those who hold more than one device in hand.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "kernels/colouring.h"
#include "kernels/hull.h"
#include "kernels/segmentation_memory.h"

namespace kinevox::kernels {

struct DeviceMemory {
    std::uint64_t used_bytes = 0;   // by all programs
    std::uint64_t total_bytes = 0;  // 0: not known
};

// Makers and stages throw DeviceError where the device is absent or fails, else what the stages' headers say.
class StageMaker {
  public:
    virtual ~StageMaker() = default;
    virtual std::unique_ptr<Segmenter> segmenter(int width, int height, int channels,
                                                 const SegmentationOptions& options) const = 0;
    virtual std::unique_ptr<RewindableSegmenter> rewindable_segmenter(
        int width, int height, int channels, const SegmentationOptions& options) const = 0;
    virtual std::unique_ptr<HullCarver> hull_carver(const HullOptions& options) const = 0;
    virtual std::unique_ptr<VoxelColourer> voxel_colourer(const ColouringOptions& options) const = 0;

    virtual std::string problem()
        const = 0;  // empty where the device can be used, else why not, without a full stop
    virtual std::string name()
        const = 0;  // of the device, "NVIDIA T4" for instance; empty where there is none
    virtual DeviceMemory memory() const = 0;  // of a GPU that can be used; any thread
};

std::unique_ptr<StageMaker> make_stage_maker(Device device);

}  // namespace kinevox::kernels
