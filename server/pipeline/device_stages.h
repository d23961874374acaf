// The kernels of one pipeline, on the GPU until it fails, then on the CPU.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "common/camera.h"
#include "kernels/stages.h"
#include "server/pipeline/gpu.h"

namespace kinevox {

struct PipelineOptions;

// Of one device.
struct Stages {
    std::vector<std::unique_ptr<kernels::Segmenter>> segmenters;  // per camera
    std::vector<kernels::RewindableSegmenter*> rewindable;        // the same, if discontinuities are allowed
    std::unique_ptr<kernels::HullCarver> carver, many_views_carver;  // the latter for four or more cameras
    std::unique_ptr<kernels::VoxelColourer> colourer;                // null without colouring
};

// Used by one thread.
class DeviceStages {
  public:
    // Throws what the factories throw; failures of `options.gpu` are handled.
    DeviceStages(const std::vector<Camera>& cameras, const PipelineOptions& options);

    // Also of the CPU's segmenters, so that they can take over: their models then have no later updates.
    // `images`: per camera.
    void learn(const std::vector<std::vector<kernels::ImageView>>& images);
    void forget_frames();

    // Calls work(stages), and again with the CPU's if the GPU fails in it: `work` must not depend on what its
    // first call left.
    void run(const std::function<void(Stages&)>& work);

  private:
    const std::shared_ptr<Gpu> gpu_;      // null: no second device
    std::unique_ptr<Stages> gpu_stages_;  // null once it has failed
    std::unique_ptr<Stages> stages_;      // of the configured device; with a GPU the CPU's
};

}  // namespace kinevox
