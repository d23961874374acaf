// Segmentation on the device, step for step as kernels/cpu/segmentation.cc. The host learns the first model,
// finds the image's gain from a grid of pixels (it keeps a copy of the reference) and keeps the subject's
// colours.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "kernels/cpu/foreground_colours.h"
#include "kernels/cpu/segmentation_density.h"
#include "kernels/cpu/segmentation_masks.h"
#include "kernels/cpu/segmentation_model.h"
#include "kernels/cuda/components.h"
#include "kernels/cuda/forms.h"
#include "kernels/cuda/segmentation_steps.h"
#include "kernels/floor_grid.h"
#include "kernels/segmentation_memory.h"

namespace kinevox::kernels {
namespace cuda {
namespace {

using kde::kCellPixels;

// As in the CPU form.
constexpr float kSmoothing_px = 1.0f;
constexpr float kColourMemory = 0.9f;
constexpr float kSureEvidence = 3.0f;

class CudaSegmenter final : public RewindableSegmenter {
  public:
    CudaSegmenter(int width, int height, int channels, const SegmentationOptions& options);
    void learn(std::span<const ImageView> empty_scene) override;
    bool learned() const override { return learned_; }
    void keep_learned() override { keep_learned_ = true; }
    void forget_frames() override;
    void set_camera(const CameraModel& camera) override;
    void begin_frame(const ImageView& image, const SegmentationPrior& prior) override;
    void decide(std::span<const Segmenter* const> others, Silhouettes& out) override;
    void end_frame(const Silhouettes& out) override;
    const kde::SceneView* scene() const override { return has_camera_ ? &scene_ : nullptr; }

  private:
    void begin();
    template <class T>
    T* place(DeviceBuffer<T>& buffer, std::size_t size) {
        buffer.resize(size);
        return buffer.data();
    }
    template <class From>
    auto* keep(DeviceBuffer<typename From::value_type>& buffer, const From& from) {
        PinnedBuffer<typename From::value_type> pinned;
        pinned.resize(from.size());
        std::copy(from.begin(), from.end(), pinned.data());
        upload(stream_, buffer, pinned);
        stream_.wait();
        return buffer.data();
    }
    void start_frame(const ImageView& image, const SegmentationPrior& prior);
    CellRange find_active(const CellRange& work);
    void vote();
    void silhouettes(const Rect& box, const Rect& limit, const SegmentationPrior& prior);
    void update(const CellRange& work, bool tracked);
    void finish_frame(const Rect& box, Silhouettes& out);

    FloorScenes floor_scenes(std::span<const Segmenter* const> others) const;

    SegmentationOptions options_;
    bool has_camera_ = false;
    kde::SceneView scene_;
    CameraModel camera_;
    FloorDirections directions_;
    kde::FloorGrid floor_grid_;
    DeviceBuffer<float> floor_directions_;
    // The frame between begin_frame() and end_frame().
    SegmentationPrior prior_;
    CellRange work_, active_box_;
    bool learned_ = false, keep_learned_ = false;
    std::int64_t frame_ = 0;
    cpu::BackgroundModel model_;          // of which only `reference` follows the device's
    cpu::BackgroundModel learned_model_;  // empty unless it is kept
    cpu::ForegroundColours colours_;
    std::vector<float> log_foreground_;
    std::vector<std::int32_t> counts_;
    Stream stream_;
    SegmentData data_{};
    MaskCleaner cleaner_;
    DeviceBuffer<std::uint8_t> samples_, scale_, reference_, candidate_, visits_, image_, values_, density_;
    DeviceBuffer<std::uint8_t> candidates_, active_, probability_of_, masks_, zones_, expected_;
    DeviceBuffer<float> log_peak_, planes_, log_lit_, log_scale_, device_log_foreground_;
    DeviceBuffer<std::int8_t> votes_;
    DeviceBuffer<std::uint8_t> added_;
    DeviceBuffer<int> changed_;
    DeviceBuffer<float> support_;
    DeviceBuffer<int> numbers_, colour_counts_;
    DeviceBuffer<unsigned long long> sums_;
    PinnedBuffer<std::uint8_t> host_image_, host_expected_, host_masks_, host_reference_;
    PinnedBuffer<float> host_log_foreground_;
    PinnedBuffer<int> host_numbers_, host_counts_;
    PinnedBuffer<unsigned long long> host_sums_;
};

CudaSegmenter::CudaSegmenter(int width, int height, int channels, const SegmentationOptions& options)
    : options_(options), colours_(channels) {
    data_.width = width, data_.height = height, data_.channels = channels;
    data_.sample_count = options.samples;
    data_.cells_per_row = (width + kCellPixels - 1) / kCellPixels;
    data_.tables = cpu::make_density_tables(options.samples);
    data_.parameters.darkest = options.darkest_shadow;
    data_.parameters.brightest = options.brightest_light;
    data_.parameters.log_prior_light = std::log(options.light_change_prior);
    std::vector<float> log_lit(256);
    std::vector<std::uint8_t> probability(256);
    for (int i = 0; i < 256; ++i) {
        log_lit[i] = std::log(std::max(i, 1) / 255.0f * static_cast<float>(kde::saturation(options.samples)));
        const float evidence = (static_cast<float>(i) - 127.5f) / 127.5f * data_.parameters.limit;
        probability[i] = static_cast<std::uint8_t>(std::lround(255.0f / (1.0f + std::exp(-evidence))));
    }
    data_.log_lit = keep(log_lit_, log_lit);
    data_.log_scale = keep(log_scale_, cpu::log_scales());
    data_.probability_of = keep(probability_of_, probability);
}

void CudaSegmenter::learn(std::span<const ImageView> empty_scene) {
    if (empty_scene.empty())
        throw std::invalid_argument("segmentation: the background needs at least one image");
    for (const ImageView& image : empty_scene)
        cpu::check_image(image, data_.width, data_.height, data_.channels);
    stream_.wait();
    model_ = cpu::learn_background(empty_scene, data_.width, data_.height, data_.channels, options_);
    if (keep_learned_) learned_model_ = model_;
    begin();
}

void CudaSegmenter::forget_frames() {
    if (!learned_ || !keep_learned_)
        throw std::logic_error(
            "segmentation: no learned background was kept; call keep_learned() before learn()");
    stream_.wait();
    model_ = learned_model_;
    begin();
}

// The first frame is still to come.
void CudaSegmenter::begin() {
    data_.samples = keep(samples_, model_.samples);
    data_.scale = keep(scale_, model_.bandwidth_scale);
    data_.reference = keep(reference_, model_.reference);
    data_.candidate = keep(candidate_, model_.candidate);
    data_.visits = keep(visits_, model_.candidate_visits);
    data_.log_peak = keep(log_peak_, model_.log_peak);
    const std::size_t pixels = static_cast<std::size_t>(data_.width) * data_.height;
    const std::size_t cells = model_.cell_index(data_.height, 0), plane = data_.plane_size();
    data_.image = place(image_, pixels * data_.channels);
    host_image_.resize(pixels * data_.channels);
    data_.values = place(values_, cells * model_.cell_bytes());
    data_.density = place(density_, cells * kCellPixels);
    data_.candidates = place(candidates_, cells);
    data_.active = place(active_, cells);
    float* planes = place(planes_, 12 * plane);
    data_.weighted_value = planes, data_.weighted_energy = planes + plane, data_.factor = planes + 2 * plane;
    data_.residual = planes + 3 * plane, data_.evidence = planes + 4 * plane,
    data_.smoothed = planes + 5 * plane;
    data_.neighbourhood = planes + 6 * plane, data_.product = planes + 7 * plane;
    data_.energy = planes + 8 * plane, data_.square = planes + 9 * plane, data_.misfit = planes + 10 * plane;
    data_.voted = planes + 11 * plane;
    data_.probability = place(masks_, 3 * pixels);
    data_.sharp = data_.probability + pixels, data_.loose = data_.probability + 2 * pixels;
    host_masks_.resize(3 * pixels);
    data_.zones = place(zones_, pixels);
    data_.active_box = place(numbers_, 13);
    data_.bounds = data_.active_box + 4;
    data_.vote_box = data_.active_box + 8;
    host_numbers_.resize(13);
    const std::size_t blocks = static_cast<std::size_t>(data_.vote_columns()) * data_.vote_rows();
    data_.votes = place(votes_, blocks);
    data_.changed = place(changed_, blocks);
    data_.added = place(added_, blocks);
    data_.support = place(support_, static_cast<std::size_t>(data_.support_columns()) * data_.support_rows());
    data_.sums = place(sums_, 3);
    host_sums_.resize(3);
    data_.colour_counts = place(colour_counts_, colours_.bins());
    host_counts_.resize(colours_.bins());
    host_log_foreground_.resize(colours_.bins());
    data_.log_foreground = place(device_log_foreground_, colours_.bins());
    colours_.clear();
    frame_ = 0;
    learned_ = true;
}

// Copies what the frame needs and clears what it fills.
void CudaSegmenter::start_frame(const ImageView& image, const SegmentationPrior& prior) {
    const std::size_t pixels = static_cast<std::size_t>(data_.width) * data_.height;
    const std::size_t row_bytes = static_cast<std::size_t>(data_.width) * data_.channels;
    for (int y = 0; y < data_.height; ++y) {
        std::memcpy(host_image_.data() + y * row_bytes, image.row(y), row_bytes);
    }
    upload(stream_, image_, host_image_);
    data_.expected = nullptr;
    if (prior.expected && !prior.region.empty()) {
        host_expected_.resize(pixels);
        std::memcpy(host_expected_.data(), prior.expected, pixels);
        upload(stream_, expected_, host_expected_);
        data_.expected = expected_.data();
    }
    fill_bytes(stream_, masks_.data(), 0, 3 * pixels);
    fill_bytes(stream_, sums_.data(), 0, 3);
    fill_bytes(stream_, colour_counts_.data(), 0, colour_counts_.size());
    fill_bytes(stream_, changed_.data(), 0, changed_.size());
    fill_bytes(stream_, added_.data(), 0, added_.size());
    const int numbers[13] = {data_.height,
                             0,
                             data_.cells_per_row,
                             0,
                             data_.width,
                             data_.height,
                             0,
                             0,
                             data_.vote_columns(),
                             data_.vote_rows(),
                             0,
                             0};
    std::copy_n(numbers, 13, host_numbers_.data());
    upload(stream_, numbers_, host_numbers_);
    colours_.log_density(options_.colour_memory_weight, log_foreground_);
    std::copy(log_foreground_.begin(), log_foreground_.end(), host_log_foreground_.data());
    upload(stream_, device_log_foreground_, host_log_foreground_);
    const auto inverse = cpu::fixed_point_inverse(cpu::estimate_gain(model_, image));
    std::copy(inverse.begin(), inverse.end(), data_.gain_64);
}

CellRange CudaSegmenter::find_active(const CellRange& work) {
    queue_density(stream_, data_, work);
    queue_active(stream_, data_, work);
    download(stream_, host_numbers_.data(), data_.active_box, 4);
    stream_.wait();
    return {host_numbers_[0], host_numbers_[1], host_numbers_[2], host_numbers_[3]};
}

void CudaSegmenter::silhouettes(const Rect& box, const Rect& limit, const SegmentationPrior& prior) {
    const auto log_odds = [](float probability) { return std::log(probability / (1 - probability)); };
    queue_decisions(stream_, data_, box, log_odds(options_.sharp_threshold),
                    log_odds(options_.loose_threshold));
    const std::uint8_t* seed = prior.region.empty() ? nullptr : data_.expected;
    for (std::uint8_t* mask : {data_.loose, data_.sharp}) {
        cleaner_.remove_small_components(stream_, mask, data_.width, box, options_.min_component_px,
                                         options_.min_component_fraction, seed);
        cleaner_.fill_holes(stream_, mask, data_.width, box, options_.max_hole_px,
                            options_.max_hole_fraction);
    }
    if (options_.colour_memory_weight > 0) {
        queue_colour_counts(stream_, data_, box, kSureEvidence);
        download(stream_, host_counts_.data(), data_.colour_counts, host_counts_.size());
    }
    if (options_.refine_border) {
        find_zones(stream_, data_.sharp, data_.width, data_.height,
                   cpu::grown(box, kde::kBorderRadius, data_.width, data_.height), data_.zones);
        queue_border(stream_, data_, box, limit);
        cleaner_.remove_small_components(stream_, data_.sharp, data_.width, box,
                                         options_.min_component_px / 3, 0, nullptr);
    }
    queue_measure(stream_, data_, box);
}

void CudaSegmenter::update(const CellRange& work, bool tracked) {
    const int interval = options_.update_interval;
    if (interval == 0) return;
    const int phase = static_cast<int>(frame_ % interval);
    queue_density_of_rows(stream_, data_, work, phase, interval);
    queue_update(stream_, data_, cpu::update_parameters(options_, frame_ / interval), phase, interval,
                 tracked);
    // The host's copy of the reference follows.
    const std::size_t row_bytes = data_.cells_per_row * model_.cell_bytes();
    host_reference_.resize(model_.reference.size());
    for (int y = phase; y < data_.height; y += interval) {
        download(stream_, host_reference_.data() + y * row_bytes, data_.reference + y * row_bytes, row_bytes);
    }
    stream_.wait();
    for (int y = phase; y < data_.height; y += interval) {
        std::memcpy(model_.reference.data() + y * row_bytes, host_reference_.data() + y * row_bytes,
                    row_bytes);
    }
}

void CudaSegmenter::finish_frame(const Rect& box, Silhouettes& out) {
    const std::size_t pixels = static_cast<std::size_t>(data_.width) * data_.height;
    const std::size_t first = static_cast<std::size_t>(box.y0) * data_.width;
    const std::size_t count = static_cast<std::size_t>(box.height()) * data_.width;
    for (int n = 0; n < 3; ++n) {
        download(stream_, host_masks_.data() + n * pixels + first, masks_.data() + n * pixels + first, count);
    }
    download(stream_, host_numbers_.data(), data_.bounds, 4);
    download(stream_, host_sums_.data(), data_.sums, 3);
    stream_.wait();
    std::vector<std::uint8_t>* planes[3] = {&out.probability, &out.sharp, &out.loose};
    for (int n = 0; n < 3; ++n) {
        std::copy_n(host_masks_.data() + n * pixels + first, count,
                    planes[n]->begin() + static_cast<std::ptrdiff_t>(first));
    }
    const Rect bounds{host_numbers_[0], host_numbers_[1], host_numbers_[2], host_numbers_[3]};
    out.bounds = bounds.empty() ? Rect{} : bounds;
    out.sharp_pixels = static_cast<std::int64_t>(host_sums_[0]);
    const auto mean = [&](int n) {
        return out.sharp_pixels > 0
                   ? static_cast<double>(host_sums_[n]) / static_cast<double>(out.sharp_pixels)
                   : 0;
    };
    out.centroid_x = mean(1), out.centroid_y = mean(2);
}

void CudaSegmenter::set_camera(const CameraModel& camera) {
    stream_.wait();
    scene_.camera = make_projector(camera, "segmentation");
    camera_ = camera;
    directions_ = floor_directions(camera);
    floor_grid_.directions = keep(floor_directions_, directions_.xy);
    floor_grid_.columns = directions_.columns;
    std::copy_n(directions_.centre, 3, floor_grid_.centre);
    has_camera_ = true;
}

void CudaSegmenter::begin_frame(const ImageView& image, const SegmentationPrior& prior) {
    if (!learned_) throw std::logic_error("segmentation: learn() the background before segmenting");
    cpu::check_image(image, data_.width, data_.height, data_.channels);
    stream_.wait();
    prior_ = prior;
    Rect asked{0, 0, data_.width, data_.height};
    if (!prior.full_pass && !prior.region.empty()) {
        const Rect& r = prior.region;
        asked = {std::max(r.x0, 0), std::max(r.y0, 0), std::min(r.x1, data_.width),
                 std::min(r.y1, data_.height)};
        if (asked.empty()) asked = {};
    }
    work_ = {asked.y0, asked.y1, asked.x0 / kCellPixels, (asked.x1 + kCellPixels - 1) / kCellPixels};
    start_frame(image, prior);
    scene_.image = data_.image;
    scene_.image_stride = static_cast<std::ptrdiff_t>(data_.width) * data_.channels;
    scene_.reference = data_.reference;
    scene_.scale = data_.scale;
    std::copy_n(data_.gain_64, 3, scene_.inverse_gain);
    scene_.channels = data_.channels;
    scene_.cells_per_row = data_.cells_per_row;
    active_box_ = find_active(work_);  // waits: the image is there for the other cameras
    if (!active_box_.empty()) queue_evidence(stream_, data_, active_box_);
    if (has_camera_) vote();
}

// Counts the blocks' votes and finds the bounds of what is plainly the subject; waits, so that the other
// cameras find them.
void CudaSegmenter::vote() {
    queue_votes(stream_, data_, active_box_);
    download(stream_, host_numbers_.data() + 8, data_.vote_box, 4);
    stream_.wait();
    scene_.votes = data_.votes;
    scene_.vote_columns = data_.vote_columns();
    constexpr int kBlock = kde::kVoteBlock_px;
    const Rect subject{kBlock * host_numbers_[8], kBlock * host_numbers_[9], kBlock * host_numbers_[10],
                       kBlock * host_numbers_[11]};
    scene_.sees = !subject.empty();
    if (scene_.sees) subject_bounds(subject, camera_, directions_, scene_.bounds);
}

FloorScenes CudaSegmenter::floor_scenes(std::span<const Segmenter* const> others) const {
    FloorScenes floor;
    if (!has_camera_) return floor;
    floor.grid = floor_grid_;
    floor.camera = scene_.camera;
    for (const Segmenter* other : others) {
        const kde::SceneView* scene = other == this ? nullptr : other->scene();
        if (scene && scene->channels == data_.channels && floor.count < kde::kMaxFloorViews)
            floor.others[floor.count++] = *scene;
    }
    return floor;
}

void CudaSegmenter::decide(std::span<const Segmenter* const> others, Silhouettes& out) {
    const std::size_t pixels = static_cast<std::size_t>(data_.width) * data_.height;
    out.width = data_.width, out.height = data_.height;
    for (auto* plane : {&out.probability, &out.sharp, &out.loose}) plane->assign(pixels, 0);
    out.searched = {work_.k0 * kCellPixels, work_.y0, std::min(work_.k1 * kCellPixels, data_.width),
                    work_.y1};
    Rect box;
    if (!active_box_.empty()) {
        float taps[3], sum = 0;
        for (int i = 0; i < 3; ++i) {
            taps[i] =
                std::exp(-0.5f * static_cast<float>((i - 2) * (i - 2)) / (kSmoothing_px * kSmoothing_px));
            sum += i < 2 ? 2 * taps[i] : taps[i];
        }
        const FloorScenes floor = floor_scenes(others);
        if (floor.count > 0) queue_shadows(stream_, data_, active_box_, floor);
        queue_smoothing(stream_, data_, active_box_, {taps[0] / sum, taps[1] / sum, taps[2] / sum});
        box = {active_box_.k0 * kCellPixels, active_box_.y0,
               std::min(active_box_.k1 * kCellPixels, data_.width), active_box_.y1};
        silhouettes(box, out.searched, prior_);
    }
    finish_frame(box, out);
    if (!active_box_.empty() && options_.colour_memory_weight > 0) {
        counts_.assign(host_counts_.data(), host_counts_.data() + host_counts_.size());
        colours_.add(counts_, kColourMemory);
    }
}

// The masks are still on the device.
void CudaSegmenter::end_frame(const Silhouettes&) {
    update(work_, !prior_.region.empty());
    ++frame_;
}

}  // namespace
}  // namespace cuda

std::unique_ptr<Segmenter> make_segmenter_cuda(int width, int height, int channels,
                                               const SegmentationOptions& options) {
    cuda::require_gpu("segmentation");
    return std::make_unique<cuda::CudaSegmenter>(width, height, channels, options);
}

}  // namespace kinevox::kernels
