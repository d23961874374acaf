#include "tests/support/failing_gpu.h"

#include <utility>

#include "kernels/device_error.h"

namespace kinevox::testing {
namespace {

void fail_if(const GpuFails& fails, const char* stage) {
    if (fails(stage))
        throw kernels::DeviceError(std::string("CUDA: an illegal memory access was encountered in ") + stage);
}

class FailingSegmenter final : public kernels::RewindableSegmenter {
  public:
    FailingSegmenter(GpuFails fails, std::unique_ptr<kernels::RewindableSegmenter> inner)
        : fails_(std::move(fails)), inner_(std::move(inner)) {}
    void learn(std::span<const kernels::ImageView> empty_scene) override {
        fail_if(fails_, "learning");
        inner_->learn(empty_scene);
    }
    bool learned() const override { return inner_->learned(); }
    void keep_learned() override { inner_->keep_learned(); }
    void forget_frames() override { inner_->forget_frames(); }
    void set_judge_faint(bool judge) override { inner_->set_judge_faint(judge); }
    void set_camera(const kernels::CameraModel& camera) override { inner_->set_camera(camera); }
    void begin_frame(const kernels::ImageView& image, const kernels::SegmentationPrior& prior) override {
        inner_->begin_frame(image, prior);
    }
    void decide(std::span<const kernels::Segmenter* const> others, kernels::Silhouettes& out) override {
        inner_->decide(others, out);
        if (!fails_("segmentation")) return;
        out = {};  // half of it is there
        out.loose.assign(7, 255);
        throw kernels::DeviceError("CUDA: an illegal memory access was encountered in segmentation");
    }
    void end_frame(const kernels::Silhouettes& out) override { inner_->end_frame(out); }
    const kernels::kde::SceneView* scene() const override { return inner_->scene(); }

  private:
    const GpuFails fails_;
    const std::unique_ptr<kernels::RewindableSegmenter> inner_;
};

class FailingCarver final : public kernels::HullCarver {
  public:
    FailingCarver(GpuFails fails, std::unique_ptr<kernels::HullCarver> inner)
        : fails_(std::move(fails)), inner_(std::move(inner)) {}
    void carve(std::span<const kernels::HullView> views, const kernels::Lattice& lattice,
               kernels::VoxelVolume& out) override {
        inner_->carve(views, lattice, out);
        if (fails_("hull")) out.bricks.resize(out.bricks.size() / 2);
        fail_if(fails_, "hull");
    }

  private:
    const GpuFails fails_;
    const std::unique_ptr<kernels::HullCarver> inner_;
};

class FailingColourer final : public kernels::VoxelColourer {
  public:
    FailingColourer(GpuFails fails, std::unique_ptr<kernels::VoxelColourer> inner, bool at_once)
        : fails_(std::move(fails)), inner_(std::move(inner)), at_once_(at_once) {}
    bool carves_and_colours() const override { return at_once_; }
    void colour(std::span<const kernels::ColouringView> views, kernels::VoxelVolume& volume,
                kernels::ColouringReport& report) override {
        inner_->colour(views, volume, report);
        if (fails_("colouring")) volume.bricks.resize(volume.bricks.size() / 2);
        fail_if(fails_, "colouring");
    }

  private:
    const GpuFails fails_;
    const std::unique_ptr<kernels::VoxelColourer> inner_;
    const bool at_once_;
};

}  // namespace

std::unique_ptr<kernels::Segmenter> FailingGpu::segmenter(int width, int height, int channels,
                                                          const kernels::SegmentationOptions& options) const {
    return rewindable_segmenter(width, height, channels, options);
}

std::unique_ptr<kernels::RewindableSegmenter> FailingGpu::rewindable_segmenter(
    int width, int height, int channels, const kernels::SegmentationOptions& options) const {
    fail_if(fails_, "making");
    return std::make_unique<FailingSegmenter>(fails_,
                                              cpu_->rewindable_segmenter(width, height, channels, options));
}

std::unique_ptr<kernels::HullCarver> FailingGpu::hull_carver(const kernels::HullOptions& options) const {
    return std::make_unique<FailingCarver>(fails_, cpu_->hull_carver(options));
}

std::unique_ptr<kernels::VoxelColourer> FailingGpu::voxel_colourer(
    const kernels::ColouringOptions& options) const {
    return std::make_unique<FailingColourer>(fails_, cpu_->voxel_colourer(options), at_once_);
}

}  // namespace kinevox::testing
