#include "server/pipeline/device_stages.h"

#include <algorithm>

#include "kernels/device_error.h"
#include "server/pipeline/for_each_camera.h"
#include "server/pipeline/pipeline.h"

namespace kinevox {
namespace {

std::unique_ptr<Stages> make_stages(const kernels::StageFactory& maker, const std::vector<Camera>& cameras,
                                    const PipelineOptions& options) {
    auto stages = std::make_unique<Stages>();
    for (const Camera& camera : cameras) {
        if (options.allow_discontinuities) {
            auto segmenter = maker.rewindable_segmenter(camera.width, camera.height, 3, options.segmentation);
            stages->rewindable.push_back(segmenter.get());
            stages->segmenters.push_back(std::move(segmenter));
        } else {
            stages->segmenters.push_back(
                maker.segmenter(camera.width, camera.height, 3, options.segmentation));
        }
    }
    kernels::HullOptions many_views = options.hull;
    many_views.min_views = std::max(many_views.min_views, 3);
    stages->carver = maker.hull_carver(options.hull);
    stages->many_views_carver = maker.hull_carver(many_views);
    if (options.colouring) stages->colourer = maker.voxel_colourer(options.colour);
    return stages;
}

void learn_with(Stages& stages, const std::vector<std::vector<kernels::ImageView>>& images) {
    for_each_camera(images.size(), [&](std::size_t c) { stages.segmenters[c]->learn(images[c]); });
}

}  // namespace

DeviceStages::DeviceStages(const std::vector<Camera>& cameras, const PipelineOptions& options)
    : gpu_(options.gpu) {
    stages_ = make_stages(*kernels::make_stage_factory(gpu_ ? kernels::Device::kCpu : options.device),
                          cameras, options);
    if (!gpu_ || !gpu_->usable()) return;
    try {
        gpu_stages_ = make_stages(gpu_->stages(), cameras, options);
    } catch (const kernels::DeviceError& error) {
        gpu_->report_failure(error.what());
    }
}

void DeviceStages::run(const std::function<void(Stages&)>& work) {
    if (gpu_stages_ && !gpu_->usable()) gpu_stages_.reset();  // it failed another pipeline
    if (gpu_stages_) {
        try {
            return work(*gpu_stages_);
        } catch (const kernels::DeviceError& error) {
            gpu_->report_failure(error.what());
            gpu_stages_.reset();
        }
    }
    work(*stages_);
}

void DeviceStages::learn(const std::vector<std::vector<kernels::ImageView>>& images) {
    run([&](Stages& stages) { learn_with(stages, images); });
    if (gpu_stages_) learn_with(*stages_, images);
}

void DeviceStages::forget_frames() {
    run([](Stages& stages) {
        for_each_camera(stages.rewindable.size(),
                        [&](std::size_t c) { stages.rewindable[c]->forget_frames(); });
    });
}

}  // namespace kinevox
