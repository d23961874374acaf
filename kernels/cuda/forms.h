// The CUDA forms of the stages, for the factories; no CUDA types here. `gpu` is CUDA's index. Each throws
// DeviceError where that GPU cannot be used, and where a CUDA call fails later. Stages may be called by any
// thread, which then keeps their GPU as the current one.
#pragma once

#include <memory>
#include <string>

#include "kernels/body_silhouette.h"
#include "kernels/colouring.h"
#include "kernels/device_facts.h"
#include "kernels/hull.h"
#include "kernels/moments.h"
#include "kernels/segmentation.h"
#include "kernels/stages.h"

namespace kinevox::kernels {

std::unique_ptr<HullCarver> make_hull_carver_cuda(int gpu, const HullOptions& options);
std::unique_ptr<VoxelColourer> make_voxel_colourer_cuda(int gpu, const ColouringOptions& options);
std::unique_ptr<BodySilhouetteRenderer> make_body_silhouette_renderer_cuda(int gpu);
std::unique_ptr<MomentCalculator> make_moment_calculator_cuda(int gpu, const MomentOptions& options);
std::shared_ptr<DeviceContext> make_device_context_cuda(int gpu);
// `context`: from make_device_context_cuda() of the same GPU.
std::unique_ptr<Segmenter> make_segmenter_cuda(int gpu, int width, int height, int channels,
                                               const SegmentationOptions& options,
                                               std::shared_ptr<DeviceContext> context);

// Empty where the GPU can be used, else why not, without a full stop.
std::string cuda_problem(int gpu);

// The GPU's name, "NVIDIA T4" for instance; empty where it cannot be used.
std::string cuda_device_name(int gpu);

// Its memory; zeros where it does not answer.
DeviceMemory cuda_memory(int gpu);

// See cuda_facts().
CudaFacts cuda_facts_of_runtime();

}  // namespace kinevox::kernels
