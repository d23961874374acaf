// The CUDA forms of the stages, for the factories; no CUDA types here. Each throws DeviceError where no GPU
// can be used, and where a CUDA call fails later.
#pragma once

#include <memory>
#include <string>

#include "kernels/body_silhouette.h"
#include "kernels/colouring.h"
#include "kernels/hull.h"
#include "kernels/moments.h"
#include "kernels/segmentation.h"
#include "kernels/stages.h"

namespace kinevox::kernels {

std::unique_ptr<HullCarver> make_hull_carver_cuda(const HullOptions& options);
std::unique_ptr<VoxelColourer> make_voxel_colourer_cuda(const ColouringOptions& options);
std::unique_ptr<BodySilhouetteRenderer> make_body_silhouette_renderer_cuda();
std::unique_ptr<MomentCalculator> make_moment_calculator_cuda(const MomentOptions& options);
std::shared_ptr<DeviceContext> make_device_context_cuda();
// `context`: from make_device_context_cuda().
std::unique_ptr<Segmenter> make_segmenter_cuda(int width, int height, int channels,
                                               const SegmentationOptions& options,
                                               std::shared_ptr<DeviceContext> context);

// Empty where a GPU can be used, else why not, without a full stop.
std::string cuda_problem();

// The first GPU's name, "NVIDIA T4" for instance; empty where there is none.
std::string cuda_device_name();

// Its memory; zeros where it does not answer.
DeviceMemory cuda_memory();

}  // namespace kinevox::kernels
