#include "server/pipeline/pipeline_resources.h"

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <mutex>
#include <utility>
#include <vector>

#include "kernels/device_error.h"
#include "kernels/shared/kde_shadow.h"
#include "server/pipeline/for_each_camera.h"
#include "server/pipeline/pipeline.h"
#include "server/silhouettes/to_kernel.h"

#ifdef __linux__
#include <unistd.h>

#include <filesystem>
#include <system_error>
#endif

namespace kinevox {
namespace {

// Up to kMaxFloorViews other cameras, each as far as possible from those already chosen: what hides a floor
// point from one then seldom hides it from all.
std::vector<std::size_t> floor_views_of(std::size_t camera, const std::vector<Camera>& cameras) {
    std::vector<double> distance(cameras.size());
    const auto approach = [&](std::size_t chosen) {
        for (std::size_t c = 0; c < cameras.size(); ++c)
            distance[c] =
                std::min(distance[c], norm(cameras[c].centre_in_world() - cameras[chosen].centre_in_world()));
    };
    std::fill(distance.begin(), distance.end(), std::numeric_limits<double>::infinity());
    approach(camera);
    std::vector<std::size_t> views;
    while (views.size() + 1 < cameras.size() && views.size() < kernels::kde::kMaxFloorViews) {
        views.push_back(
            static_cast<std::size_t>(std::max_element(distance.begin(), distance.end()) - distance.begin()));
        approach(views.back());
    }
    return views;
}

void place_cameras(Stages& stages, const std::vector<Camera>& cameras) {
    stages.floor_views.clear();
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        stages.segmenters[c]->set_camera(to_kernel(cameras[c]));
        stages.floor_views.push_back(floor_views_of(c, cameras));
    }
}

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
    place_cameras(*stages, cameras);
    kernels::HullOptions many_views = options.hull;
    many_views.min_views = std::max(many_views.min_views, kernels::kMinViewsOfMany);
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

void DeviceStages::set_cameras(const std::vector<Camera>& cameras) {
    run([&](Stages& stages) { place_cameras(stages, cameras); });
    if (gpu_stages_) place_cameras(*stages_, cameras);
}

void DeviceStages::forget_frames() {
    run([](Stages& stages) {
        for_each_camera(stages.rewindable.size(),
                        [&](std::size_t c) { stages.rewindable[c]->forget_frames(); });
    });
}

namespace {

constexpr std::size_t kKeptIdle = 4;

}  // namespace

struct ResultPool::Shelf {
    std::mutex mutex;
    std::vector<std::unique_ptr<FrameResult>> idle;
};

ResultPool::ResultPool() : shelf_(std::make_shared<Shelf>()) {}

std::shared_ptr<FrameResult> ResultPool::take() {
    std::unique_ptr<FrameResult> result;
    {
        const std::lock_guard lock(shelf_->mutex);
        if (!shelf_->idle.empty()) {
            result = std::move(shelf_->idle.back());
            shelf_->idle.pop_back();
        }
    }
    if (!result) result = std::make_unique<FrameResult>();
    return {result.release(), [shelf = shelf_](FrameResult* used) {
                std::unique_ptr<FrameResult> back(used);
                // The images and the volume go now, the silhouettes' buffers stay.
                auto silhouettes = std::move(back->silhouettes);
                *back = FrameResult{};
                back->silhouettes = std::move(silhouettes);
                const std::lock_guard lock(shelf->mutex);
                if (shelf->idle.size() < kKeptIdle) shelf->idle.push_back(std::move(back));
            }};
}

void restart_with_huge_pages([[maybe_unused]] char** arguments) {
#ifdef __linux__
    if (std::getenv("GLIBC_TUNABLES")) return;
    // Images and planes come from the heap, not from mappings of their own, which are too small for huge
    // pages and would be returned and cleared again with every frame.
    setenv("GLIBC_TUNABLES",
           "glibc.malloc.hugetlb=1:glibc.malloc.mmap_threshold=67108864:glibc.malloc.top_pad=16777216", 0);
    // By its own path: ps, top and the service manager call a process as the last part of what was executed.
    std::error_code error;
    const std::filesystem::path self = std::filesystem::read_symlink("/proc/self/exe", error);
    if (!error) execv(self.c_str(), arguments);  // returns only where it fails: small pages do as well
#endif
}

}  // namespace kinevox
