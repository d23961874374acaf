// What a pipeline computes with: the kernels of its device, the memory of its results, and huge pages.
#pragma once

#include <functional>
#include <memory>
#include <vector>

#include "common/camera.h"
#include "kernels/stages.h"
#include "server/pipeline/frame_result.h"
#include "server/pipeline/gpu.h"

namespace kinevox {

struct PipelineOptions;

// Of one device.
struct Stages {
    std::vector<std::unique_ptr<kernels::Segmenter>> segmenters;  // per camera
    std::vector<kernels::RewindableSegmenter*> rewindable;        // the same, if discontinuities are allowed
    std::vector<std::vector<std::size_t>>
        floor_views;  // per camera, those that its shadows are compared with
    std::unique_ptr<kernels::HullCarver> carver, many_views_carver;  // the latter for kernels::kManyCameras
    std::unique_ptr<kernels::VoxelColourer> colourer;                // null without colouring
};

// The kernels of one pipeline, on the GPU until it fails, then on the CPU. Used by one thread.
class DeviceStages {
  public:
    // Throws what the factories throw; failures of `options.gpu` are handled.
    DeviceStages(const std::vector<Camera>& cameras, const PipelineOptions& options);

    // Also of the CPU's segmenters, so that they can take over: their models then have no later updates.
    // `images`: per camera.
    void learn(const std::vector<std::vector<kernels::ImageView>>& images);
    void forget_frames();
    void set_cameras(const std::vector<Camera>& cameras);

    // Calls work(stages), and again with the CPU's if the GPU fails in it: `work` must not depend on what its
    // first call left.
    void run(const std::function<void(Stages&)>& work);

  private:
    const std::shared_ptr<Gpu> gpu_;      // null: no second device
    std::unique_ptr<Stages> gpu_stages_;  // null once it has failed
    std::unique_ptr<Stages> stages_;      // of the configured device; with a GPU the CPU's
};

// Reuses the memory of results after their last release: the silhouettes of a frame set are megabytes.
// Thread safe. Results may outlive the pool. Keeps a few idle results, frees the rest.
class ResultPool {
  public:
    ResultPool();

    // As a new FrameResult, except that `silhouettes` keeps its buffers, with old contents.
    std::shared_ptr<FrameResult> take();

  private:
    struct Shelf;
    std::shared_ptr<Shelf> shelf_;
};

// Restarts the program with glibc's tunable for huge pages, which is read from the environment at program
// start only; returns if it is set already (as after the restart) or not on Linux. Called first by main().
// A frame set reads tens of megabytes once, so TLB misses dominate: on a virtual machine, where a miss costs
// two page walks, all stages took up to 1.7 times longer with small pages, more so the longer the machine had
// been up.
void restart_with_huge_pages(char** arguments);

}  // namespace kinevox
