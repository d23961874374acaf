// The kernels of one pipeline, on the GPU as long as there is one that works, then on the CPU.
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
    std::vector<std::unique_ptr<kernels::Segmenter>> segmenters;     // a camera
    std::vector<kernels::RewindableSegmenter*> rewindable;           // the same, where frame sets may jump
    std::unique_ptr<kernels::HullCarver> carver, many_views_carver;  // the latter for four cameras and more
    std::unique_ptr<kernels::VoxelColourer> colourer;                // null without colouring
};

// Used by one thread.
class DeviceStages {
  public:
    // Throws what the makers throw; where `options.gpu` is given, its failures are none.
    DeviceStages(const std::vector<Camera>& cameras, const PipelineOptions& options);

    // Teaches the CPU's segmenters too, so that they can take over: their models are those of the empty scene
    // then. `pictures`: a camera's.
    void learn(const std::vector<std::vector<kernels::PictureView>>& pictures);
    void forget_frames();

    // Calls work(stages), once more with the CPU's where the GPU fails in it: `work` must not count on what
    // its first call left.
    void run(const std::function<void(Stages&)>& work);

  private:
    const std::shared_ptr<Gpu> gpu_;      // null: no second device
    std::unique_ptr<Stages> gpu_stages_;  // null once it has failed
    std::unique_ptr<Stages> stages_;      // what the options say; beside a GPU the CPU's
};

}  // namespace kinevox
