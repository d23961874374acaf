#include "kernels/bench/frame_set_rig.h"

#include <chrono>
#include <cmath>
#include <random>
#include <span>

#include "kernels/body_silhouette.h"
#include "kernels/stages.h"
#include "kernels/tests/capsule_body.h"

#ifdef KINEVOX_HAVE_TBB
#include <oneapi/tbb/parallel_for.h>
#endif

namespace kinevox::kernels::bench {
namespace {

constexpr int kFrames = 4, kBackgroundImages = 6;

template <class F>
void for_each_camera(std::size_t count, F body) {
#ifdef KINEVOX_HAVE_TBB
    oneapi::tbb::parallel_for(std::size_t{0}, count, body);
#else
    for (std::size_t c = 0; c < count; ++c) body(c);
#endif
}

class Clock {
  public:
    // ms since the last call.
    double lap() {
        const auto now = std::chrono::steady_clock::now();
        const double ms = std::chrono::duration<double, std::milli>(now - last_).count();
        last_ = now;
        return ms;
    }

  private:
    std::chrono::steady_clock::time_point last_ = std::chrono::steady_clock::now();
};

}  // namespace

// Squares with noise of five grey levels.
struct FrameSetRig::Background {
    static constexpr std::size_t kPeriod = 96, kShifts = 4096;  // of the squares; of the noise

    explicit Background(std::size_t values) : values_(values), noise_(values + kPeriod * kShifts) {
        for (std::size_t n = 0; n < noise_.size(); ++n)
            noise_[n] = static_cast<std::uint8_t>(90 + 40 * (n / 48 % 2) + (random_() >> 12) % 5);
    }
    // Another part of the same noise each time, which is much faster than new noise.
    std::vector<std::uint8_t> image() {
        const auto begin = noise_.begin() + static_cast<std::ptrdiff_t>(kPeriod * (random_() % kShifts));
        return {begin, begin + static_cast<std::ptrdiff_t>(values_)};
    }

  private:
    std::size_t values_;
    std::minstd_rand random_{1};
    std::vector<std::uint8_t> noise_;
};

FrameSetRig::FrameSetRig(Device device, const FrameSetSize& size) : size_(size) {
    const auto stages = make_stage_factory(device);
    carver_ = stages->hull_carver({});
    colourer_ = stages->voxel_colourer({});
    for (int n = 0; n < size.cameras; ++n) {
        const float angle = 6.2832f * static_cast<float>(n) / static_cast<float>(size.cameras);
        const float from[3] = {4 * std::cos(angle), 4 * std::sin(angle), 1.3f}, at[3] = {0, 0, 0.9f};
        const float focal_px = 0.85f * static_cast<float>(size.width);
        cameras_.push_back(testing::camera_looking(from, at, size.width, size.height, focal_px));
    }
    lattice_.voxel_m = size.voxel_m;
    for (int axis = 0; axis < 3; ++axis) {
        lattice_.size[axis] =
            static_cast<int>(std::ceil(size.span_m / size.voxel_m / kBrickEdge)) * kBrickEdge;
        const float edge_m = size.voxel_m * static_cast<float>(lattice_.size[axis]);
        lattice_.origin[axis] = axis == 2 ? -0.02f : -0.5f * edge_m;
    }
    Background background(static_cast<std::size_t>(3) * size.width * size.height);
    for (const CameraModel& camera : cameras_) {
        std::vector<std::vector<std::uint8_t>> clip;
        std::vector<ImageView> views;
        for (int n = 0; n < kBackgroundImages; ++n) clip.push_back(background.image());
        for (const auto& image : clip) views.push_back(view(image));
        segmenters_.push_back(stages->segmenter(size.width, size.height, 3, {}));
        segmenters_.back()->set_camera(camera);
        segmenters_.back()->learn(views);
    }
    for (int n = 0; n < kFrames; ++n)
        frames_.push_back(draw(0.25f + 0.05f * static_cast<float>(n), background));
    silhouettes_.resize(cameras_.size());
}

ImageView FrameSetRig::view(const std::vector<std::uint8_t>& image) const {
    return {image.data(), size_.width, size_.height, 3, static_cast<std::ptrdiff_t>(3) * size_.width};
}

FrameSetRig::Frame FrameSetRig::draw(float stride, Background& background) const {
    const auto person = testing::capsule_person(0, 0, 0.2f, stride);
    const auto renderer = make_body_silhouette_renderer(Device::kCpu);
    const std::size_t pixels = static_cast<std::size_t>(size_.width) * size_.height;
    Frame out;
    for (const CameraModel& camera : cameras_) {
        std::vector<std::uint8_t> mask(pixels);
        BodyView body{&camera, mask.data(), {}};
        renderer->render(person, std::span(&body, 1));
        auto image = background.image();
        for (std::size_t n = 0; n < pixels; ++n) {
            if (!mask[n]) continue;
            image[3 * n] = 200;
            image[3 * n + 1] = 60;
            image[3 * n + 2] = 40;
        }
        out.images.push_back(std::move(image));
        out.masks.push_back(std::move(mask));
        out.bounds.push_back(body.bounds);
    }
    return out;
}

void FrameSetRig::segment(const Frame& frame) {
    std::vector<SegmentationPrior> priors(cameras_.size());
    std::vector<const Segmenter*> others;
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        others.push_back(segmenters_[c].get());
        if (count_ == 0) continue;
        const Rect& box = frame.bounds[c];
        const int margin_x = size_.width / 16, margin_y = size_.height / 16;
        priors[c].region = {box.x0 - margin_x, box.y0 - margin_y, box.x1 + margin_x, box.y1 + margin_y};
        priors[c].full_pass = false;
        priors[c].expected = frame.masks[c].data();
    }
    for_each_camera(cameras_.size(),
                    [&](std::size_t c) { segmenters_[c]->begin_frame(view(frame.images[c]), priors[c]); });
    std::vector<FrameDecision> decisions;
    for (const auto& segmenter : segmenters_) decisions.push_back({segmenter.get(), others});
    segmenters_[0]->decide_together(decisions);
    for_each_camera(cameras_.size(), [&](std::size_t c) { segmenters_[c]->decide(others, silhouettes_[c]); });
    for_each_camera(cameras_.size(), [&](std::size_t c) { segmenters_[c]->end_frame(silhouettes_[c]); });
}

StageTimes FrameSetRig::run() {
    // Back and forth, so that consecutive frames are neighbours.
    const std::size_t phase = count_ % (2 * kFrames - 2);
    const Frame& frame = frames_[phase < kFrames ? phase : 2 * kFrames - 2 - phase];
    StageTimes out;
    Clock clock;
    segment(frame);
    ++count_;
    std::vector<HullView> hull_views;
    std::vector<ColouringView> colouring_views;
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        const Silhouettes& s = silhouettes_[c];
        hull_views.push_back({&cameras_[c], s.loose.data(), s.bounds});
        const ImageView image = view(frame.images[c]);
        colouring_views.push_back({&cameras_[c], image, s.loose.data(), s.sharp.data(), s.bounds,
                                   segmenters_[c]->image_on_device(image)});
    }
    out.segmentation_ms = clock.lap();
    ColouringReport report;
    if (colourer_->carves_and_colours()) {
        colourer_->carve_and_colour(*carver_, hull_views, lattice_, colouring_views, volume_, report);
    } else {
        carver_->carve(hull_views, lattice_, volume_);
        out.hull_ms = clock.lap();
        colourer_->colour(colouring_views, volume_, report);
    }
    out.colouring_ms = clock.lap();
    return out;
}

}  // namespace kinevox::kernels::bench
