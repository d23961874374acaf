// The stages of one device, for callers that switch between devices.
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

// Stages throw DeviceError if the device fails. Factory methods throw DeviceError if the device cannot be
// used, std::runtime_error if this build has no CUDA; otherwise errors as in the stages' headers.
class StageFactory {
  public:
    virtual ~StageFactory() = default;
    virtual std::unique_ptr<Segmenter> segmenter(int width, int height, int channels,
                                                 const SegmentationOptions& options) const = 0;
    virtual std::unique_ptr<RewindableSegmenter> rewindable_segmenter(
        int width, int height, int channels, const SegmentationOptions& options) const = 0;
    virtual std::unique_ptr<HullCarver> hull_carver(const HullOptions& options) const = 0;
    virtual std::unique_ptr<VoxelColourer> voxel_colourer(const ColouringOptions& options) const = 0;

    virtual std::string problem()
        const = 0;  // empty if the device can be used, else why not, without a full stop
    virtual Device device() const = 0;
    virtual std::string name() const = 0;     // of the device, for example "NVIDIA T4"; empty for the CPU
    virtual DeviceMemory memory() const = 0;  // of a usable GPU; any thread
};

std::unique_ptr<StageFactory> make_stage_factory(Device device);

}  // namespace kinevox::kernels
