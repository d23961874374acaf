// A simulated GPU for machines without one: it computes on the CPU and fails at a given point of its work.
#pragma once

#include <functional>
#include <string>

#include "kernels/stages.h"

namespace kinevox::testing {

// Asked by any thread before each use, with the stage's name: learning, segmentation, hull, colouring, or
// making.
using GpuFails = std::function<bool(const std::string& stage)>;

class FailingGpu final : public kernels::StageFactory {
  public:
    // `at_once`: VoxelColourer::carves_and_colours().
    explicit FailingGpu(GpuFails fails, std::string problem = {}, bool at_once = false,
                        kernels::Device device = kernels::Device::kCuda)
        : device_(device),
          fails_(std::move(fails)),
          problem_(std::move(problem)),
          at_once_(at_once),
          cpu_(make_stage_factory(kernels::Device::kCpu)) {}

    std::unique_ptr<kernels::Segmenter> segmenter(int width, int height, int channels,
                                                  const kernels::SegmentationOptions& options) const override;
    std::unique_ptr<kernels::RewindableSegmenter> rewindable_segmenter(
        int width, int height, int channels, const kernels::SegmentationOptions& options) const override;
    std::unique_ptr<kernels::HullCarver> hull_carver(const kernels::HullOptions& options) const override;
    std::unique_ptr<kernels::VoxelColourer> voxel_colourer(
        const kernels::ColouringOptions& options) const override;

    std::string problem() const override { return problem_; }
    kernels::Device device() const override { return device_; }
    std::string name() const override { return "a GPU made to fail"; }
    kernels::DeviceMemory memory() const override {
        return {std::uint64_t{3} << 30, std::uint64_t{16} << 30};
    }

  private:
    const kernels::Device device_;
    const GpuFails fails_;
    const std::string problem_;
    const bool at_once_;
    const std::unique_ptr<kernels::StageFactory> cpu_;
};

}  // namespace kinevox::testing
