// Segmentation on the device, step for step as kernels/cpu/segmenter.h, for all cameras of a frame set at
// once: begin_frame() uploads an image, and the first decide() uploads what else is new of all cameras,
// queues all steps, waits once and keeps the results for the others. The host learns the first model and
// keeps the subject's colours.
#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "kernels/cpu/foreground_colours.h"
#include "kernels/cpu/segmentation_density.h"
#include "kernels/cpu/segmentation_model.h"
#include "kernels/cpu/upload_work.h"
#include "kernels/cuda/components.h"
#include "kernels/cuda/forms.h"
#include "kernels/cuda/segmentation_results.h"
#include "kernels/cuda/segmentation_steps.h"
#include "kernels/cuda/segmentation_upload.h"
#include "kernels/floor_grid.h"
#include "kernels/segmentation_memory.h"
#include "kernels/shared/faint_weights.h"

namespace kinevox::kernels {
namespace cuda {
namespace {

using kde::kCellPixels;

// As in the CPU form.
constexpr float kSmoothing_px = 1.0f;
constexpr float kColourMemory = 0.9f;
constexpr float kSureEvidence = 3.0f;

// What the cameras of a frame set look up of each other is there without an event or a wait, since all of
// them queue their work on one stream.
struct CudaContext final : DeviceContext {
    explicit CudaContext(int gpu) : stream(gpu) {}
    Stream stream;
};

class CudaSegmenter final : public RewindableSegmenter {
  public:
    CudaSegmenter(int width, int height, int channels, const SegmentationOptions& options,
                  std::shared_ptr<CudaContext> context);
    ~CudaSegmenter() override;
    void learn(std::span<const ImageView> empty_scene) override;
    bool learned() const override { return learned_; }
    void set_judge_faint(bool judge) override;
    void keep_learned() override { keep_learned_ = true; }
    void forget_frames() override;
    void set_camera(const CameraModel& camera) override;
    void begin_frame(const ImageView& image, const SegmentationPrior& prior) override;
    void decide_together(std::span<const FrameDecision> cameras) override;
    void decide(std::span<const Segmenter* const> others, Silhouettes& out) override;
    void end_frame(const Silhouettes& out) override;
    const std::uint8_t* image_on_device(const ImageView& image) const override {
        const bool same = image.data == on_device_.data && image.width == on_device_.width &&
                          image.height == on_device_.height && image.channels == on_device_.channels;
        return same && image.data && !upload_in_flight_ ? image_.data() : nullptr;
    }
    const kde::SceneView* scene() const override { return has_camera() ? &scene_ : nullptr; }

  private:
    // Where the frame between begin_frame() and end_frame() is.
    enum class Step { kNone, kBegun, kLooked, kDecided, kUpdated };
    struct Member {
        CudaSegmenter* segmenter;
        std::vector<CudaSegmenter*> others;
    };

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
    bool has_camera() const { return data_.has_camera; }
    std::size_t pixels() const { return static_cast<std::size_t>(data_.width) * data_.height; }
    std::size_t cells() const { return data_.cell(data_.height, 0); }
    void set_options();
    void begin(const cpu::BackgroundModel& model);
    void place_planes();
    void place_frame();
    void place_scene();
    void upload_image(const ImageView& image);
    CudaSegmenter* usable(const Segmenter* other) const;
    FrameSet upload_cameras(std::span<CudaSegmenter* const> cameras);
    void decide_all(const std::vector<Member>& members, bool update);
    void prepare(const Member& member, std::span<CudaSegmenter* const> cameras);

    SegmentationOptions options_;
    const std::shared_ptr<CudaContext> context_;
    const Stream& stream_;
    SegmentData data_{};
    kde::SceneView scene_;  // with what does not change; the device has the whole one
    bool learned_ = false, keep_learned_ = false;
    std::int64_t frame_ = 0;
    cpu::BackgroundModel learned_model_;  // empty unless it is kept
    cpu::ForegroundColours colours_;
    std::vector<float> log_foreground_;
    ExpectedUpload expected_;
    std::vector<std::int32_t> counts_;
    Step step_ = Step::kNone;
    // Whether the device may still read these pieces of pinned memory.
    bool upload_in_flight_ = false, cameras_in_flight_ = false;
    Rect searched_;
    FrameResults results_;  // where the frame's results are

    // Of the model and of a frame.
    DeviceBuffer<std::uint8_t> samples_, scale_, reference_, candidate_, visits_, values_, density_;
    DeviceBuffer<std::uint8_t> candidates_, active_, near_, probability_of_;
    DeviceBuffer<float> log_peak_, planes_, log_lit_, log_scale_, floor_directions_, support_;
    DeviceBuffer<Word> masks_;
    DeviceBuffer<std::int8_t> votes_;
    DeviceBuffer<std::uint16_t> faint_;
    DeviceBuffer<int> cells_, group_spans_, tiles_, changed_, added_, run_lists_;
    DeviceBuffer<CameraState> state_;
    DeviceBuffer<kde::SceneView> device_scene_;
    ImageView on_device_;  // the host's image that `image_` has; no data: none
    DeviceBuffer<std::uint8_t> image_;
    PinnedBuffer<std::uint8_t> host_image_;
    // Of a whole frame set, where this segmenter is its first one.
    FrameUpload frame_upload_;
    ResultMemory result_memory_;
};

CudaSegmenter::CudaSegmenter(int width, int height, int channels, const SegmentationOptions& options,
                             std::shared_ptr<CudaContext> context)
    : options_(options), context_(std::move(context)), stream_(context_->stream), colours_(channels) {
    data_.width = width, data_.height = height, data_.channels = channels;
    data_.cells_per_row = (width + kCellPixels - 1) / kCellPixels;
    set_options();
    stream_.use();
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

// Others may have queued work that reads this segmenter's memory.
CudaSegmenter::~CudaSegmenter() {
    ignore_error(cudaSetDevice(stream_.gpu()));
    ignore_error(cudaStreamSynchronize(stream_.get()));
}

void CudaSegmenter::set_options() {
    const auto log_odds = [](float probability) { return std::log(probability / (1 - probability)); };
    data_.sample_count = options_.samples;
    data_.tables = cpu::make_density_tables(options_.samples);
    data_.parameters.darkest = options_.darkest_shadow;
    data_.parameters.brightest = options_.brightest_light;
    data_.parameters.log_prior_light = std::log(options_.light_change_prior);
    data_.sharp_from = log_odds(options_.sharp_threshold);
    data_.loose_from = log_odds(options_.loose_threshold);
    float taps[3], sum = 0;
    for (int i = 0; i < 3; ++i) {
        taps[i] = std::exp(-0.5f * static_cast<float>((i - 2) * (i - 2)) / (kSmoothing_px * kSmoothing_px));
        sum += i < 2 ? 2 * taps[i] : taps[i];
    }
    for (int i = 0; i < 3; ++i) data_.smoothing[i] = taps[i] / sum;
    data_.sure_evidence = kSureEvidence;
    data_.min_component_px = options_.min_component_px, data_.max_hole_px = options_.max_hole_px;
    data_.min_component_fraction = options_.min_component_fraction;
    data_.max_hole_fraction = options_.max_hole_fraction;
    data_.refine_border = options_.refine_border;
    data_.count_colours = options_.colour_memory_weight > 0;
    set_judge_faint(options_.judge_faint);
}

void CudaSegmenter::set_judge_faint(bool judge) {
    data_.judge_faint = options_.judge_faint = judge;
    data_.parameters.shadow = judge ? kde::kFaintRule : kde::ShadowRule{};
}

void CudaSegmenter::learn(std::span<const ImageView> empty_scene) {
    if (empty_scene.empty())
        throw std::invalid_argument("segmentation: the background needs at least one image");
    for (const ImageView& image : empty_scene)
        cpu::check_image(image, data_.width, data_.height, data_.channels);
    stream_.use();
    stream_.wait();
    cpu::BackgroundModel model =
        cpu::learn_background(empty_scene, data_.width, data_.height, data_.channels, options_);
    begin(model);
    if (keep_learned_) learned_model_ = std::move(model);
}

void CudaSegmenter::forget_frames() {
    if (!learned_ || !keep_learned_)
        throw std::logic_error(
            "segmentation: no learned background was kept; call keep_learned() before learn()");
    stream_.use();
    stream_.wait();
    begin(learned_model_);
}

// The first frame is still to come.
void CudaSegmenter::begin(const cpu::BackgroundModel& model) {
    data_.samples = keep(samples_, model.samples);
    data_.scale = keep(scale_, model.bandwidth_scale);
    data_.reference = keep(reference_, model.reference);
    data_.candidate = keep(candidate_, model.candidate);
    data_.visits = keep(visits_, model.candidate_visits);
    data_.log_peak = keep(log_peak_, model.log_peak);
    place_planes();
    place_frame();
    colours_.clear();
    frame_ = 0;
    step_ = Step::kNone;
    learned_ = true;
}

// The planes hold neutral values where no cell was active in the last frame.
void CudaSegmenter::place_planes() {
    constexpr int kZero = 9, kLimit = 3;
    const std::size_t plane = data_.plane_size();
    float* next = place(planes_, (kZero + kLimit) * plane);
    fill_bytes(stream_, next, 0, kZero * plane);
    queue_fill(stream_, next + kZero * plane, -data_.parameters.limit, kLimit * plane);
    for (float** of : {&data_.weighted_value, &data_.weighted_energy, &data_.product, &data_.energy,
                       &data_.square, &data_.factor, &data_.residual, &data_.neighbourhood, &data_.misfit,
                       &data_.evidence, &data_.voted, &data_.smoothed}) {
        *of = next;
        next += plane;
    }
    data_.active = place(active_, cells());
    fill_bytes(stream_, data_.active, 0, cells());
}

void CudaSegmenter::place_frame() {
    data_.values = place(values_, cells() * data_.channels * kCellPixels);
    data_.density = place(density_, cells() * kCellPixels);
    data_.candidates = place(candidates_, cells());
    data_.cells = place(cells_, cells());
    data_.group_spans = place(group_spans_, static_cast<std::size_t>(2) * data_.height);
    const auto tiles = static_cast<std::size_t>(data_.tiles());
    data_.near = place(near_, tiles);
    fill_bytes(stream_, data_.near, 0, tiles);
    int* lists_of_tiles = place(tiles_, 2 * tiles);
    data_.near_tiles = lists_of_tiles, data_.active_tiles = lists_of_tiles + tiles;
    Word* masks = place(masks_, 3 * cells());
    data_.sharp = masks, data_.loose = masks + cells(), data_.refined = masks + 2 * cells();
    const std::size_t list = run_list_size(data_.width, data_.height);
    int* lists = place(run_lists_, 2 * list);
    for (int n = 0; n < 2; ++n) data_.runs[n] = run_lists(lists + n * list, data_.width, data_.height);
    data_.state = place(state_, 1);
    const std::size_t blocks = static_cast<std::size_t>(data_.vote_columns()) * data_.vote_rows();
    data_.votes = place(votes_, blocks);
    data_.faint = place(faint_, static_cast<std::size_t>(data_.vote_rows()) * data_.cells_per_row);
    data_.changed = place(changed_, blocks);
    data_.added = place(added_, blocks);
    data_.support = place(support_, static_cast<std::size_t>(data_.support_columns()) * data_.support_rows());
    data_.colour_bins = colours_.bins();
    host_image_.resize(pixels() * data_.channels);
    data_.image = place(image_, host_image_.size());
    on_device_ = {};
    place_scene();
}

// What the other cameras look up; the device adds what it finds in a frame.
void CudaSegmenter::place_scene() {
    scene_.camera = data_.camera;
    scene_.image = data_.image;
    scene_.image_stride = static_cast<std::ptrdiff_t>(data_.width) * data_.channels;
    scene_.reference = data_.reference;
    scene_.scale = data_.scale;
    scene_.channels = data_.channels;
    scene_.cells_per_row = data_.cells_per_row;
    scene_.votes = data_.votes;
    scene_.vote_columns = data_.vote_columns();
    data_.scene = keep(device_scene_, std::vector<kde::SceneView>{scene_});
}

void CudaSegmenter::set_camera(const CameraModel& camera) {
    stream_.use();
    stream_.wait();
    data_.camera = make_projector(camera, "segmentation");
    const FloorDirections directions = floor_directions(camera);
    data_.floor.directions = keep(floor_directions_, directions.xy);
    data_.floor.columns = directions.columns;
    data_.floor_rows = directions.rows;
    std::copy_n(directions.centre, 3, data_.floor.centre);
    data_.has_camera = true;
    place_scene();
}

// A large image is on its way while the rest of it is copied. Small pieces do not pay: the calls of several
// threads wait for each other in the driver. A worker thread may call it.
void CudaSegmenter::upload_image(const ImageView& image) {
    stream_.use();
    constexpr std::size_t kPiece = 2 << 20;  // bytes
    const std::size_t row_bytes = static_cast<std::size_t>(data_.width) * data_.channels;
    const int rows = static_cast<int>(std::max<std::size_t>(1, kPiece / row_bytes));
    for (int y = 0; y < data_.height; y += rows) {
        const int end = std::min(y + rows, data_.height);
        cpu::copy_rows(image, y, end, host_image_.data());
        upload(stream_, image_.data() + y * row_bytes, host_image_.data() + y * row_bytes,
               (end - y) * row_bytes);
    }
}

// Uploads the image, and has no other part in the work on it, so that the cameras' threads do not meet.
void CudaSegmenter::begin_frame(const ImageView& image, const SegmentationPrior& prior) {
    if (!learned_) throw std::logic_error("segmentation: learn() the background before segmenting");
    cpu::check_image(image, data_.width, data_.height, data_.channels);
    stream_.use();
    if (upload_in_flight_) stream_.wait();
    data_.tracked = !prior.region.empty();
    searched_ = {0, 0, data_.width, data_.height};
    if (!prior.full_pass && data_.tracked) {
        const Rect& r = prior.region;
        searched_ = {std::max(r.x0, 0), std::max(r.y0, 0), std::min(r.x1, data_.width),
                     std::min(r.y1, data_.height)};
        if (searched_.empty()) searched_ = {};
    }
    data_.work = {searched_.y0, searched_.y1, searched_.x0 / kCellPixels,
                  (searched_.x1 + kCellPixels - 1) / kCellPixels};
    searched_ = {data_.work.k0 * kCellPixels, data_.work.y0,
                 std::min(data_.work.k1 * kCellPixels, data_.width), data_.work.y1};
    upload_in_flight_ = true;
    on_device_ = image;
    expected_.clear();
    std::vector<std::function<void()>> tasks;  // the others are worked out while the image is copied
    tasks.emplace_back([&] { upload_image(image); });
    tasks.emplace_back([&] { colours_.log_density(options_.colour_memory_weight, log_foreground_); });
    if (prior.expected && data_.tracked)
        tasks.emplace_back([&] { expected_.pack(prior.expected, data_.width, data_.height); });
    cpu::run_all(tasks);
    step_ = Step::kBegun;
}

// The segmenter that `other` is, if this one can compare its shadows with it.
CudaSegmenter* CudaSegmenter::usable(const Segmenter* other) const {
    auto* const segmenter = const_cast<CudaSegmenter*>(dynamic_cast<const CudaSegmenter*>(other));
    const bool is = segmenter && segmenter != this && has_camera() && segmenter->has_camera() &&
                    segmenter->data_.channels == data_.channels && segmenter->step_ != Step::kNone;
    if (is && segmenter->context_ != context_)
        throw std::logic_error("segmentation: the cameras of a frame set need one device context");
    return is ? segmenter : nullptr;
}

// What is asked of a camera in this frame set, but for where its results go.
void CudaSegmenter::prepare(const Member& member, std::span<CudaSegmenter* const> cameras) {
    data_.other_count = 0;
    for (const CudaSegmenter* other : member.others)
        data_.others[data_.other_count++] =
            static_cast<int>(std::find(cameras.begin(), cameras.end(), other) - cameras.begin());
    data_.interval = options_.update_interval;
    if (data_.interval == 0) return;
    data_.phase = static_cast<int>(frame_ % data_.interval);
    data_.update = cpu::update_parameters(options_, frame_ / data_.interval);
}

FrameSet CudaSegmenter::upload_cameras(std::span<CudaSegmenter* const> cameras) {
    if (cameras_in_flight_) stream_.wait();  // end_frame() after decide() alone
    std::vector<CameraUpload> uploads;
    for (const CudaSegmenter* camera : cameras)
        uploads.push_back(
            {&camera->data_, camera->step_ == Step::kBegun, camera->log_foreground_, &camera->expected_});
    cameras_in_flight_ = true;
    return frame_upload_.upload(stream_, uploads);
}

// All steps of the members, which this segmenter is the first of. Waits once.
void CudaSegmenter::decide_all(const std::vector<Member>& members, bool update) {
    stream_.use();
    std::vector<CudaSegmenter*> cameras;
    for (const Member& member : members) cameras.push_back(member.segmenter);
    for (const Member& member : members)
        for (CudaSegmenter* other : member.others)
            if (std::find(cameras.begin(), cameras.end(), other) == cameras.end()) cameras.push_back(other);
    const int count = static_cast<int>(members.size());
    std::vector<SegmentData*> deciding;
    for (const Member& member : members) {
        member.segmenter->prepare(member, cameras);
        deciding.push_back(&member.segmenter->data_);
    }
    const std::vector<FrameResults> results = result_memory_.place(deciding);
    for (int n = 0; n < count; ++n) members[n].segmenter->results_ = results[n];
    const FrameSet set = upload_cameras(cameras);
    if (std::any_of(cameras.begin(), cameras.end(),
                    [](const CudaSegmenter* camera) { return camera->step_ == Step::kBegun; })) {
        queue_density(stream_, set);
        queue_evidence(stream_, set);
    }
    result_memory_.queue_clear(stream_);
    queue_shadows(stream_, set, count);
    queue_decisions(stream_, set, count);
    queue_cleaning(stream_, set, count);
    queue_border(stream_, set, count);
    queue_results(stream_, set, count);
    result_memory_.queue_download(stream_);
    stream_.wait();
    cameras_in_flight_ = false;
    for (CudaSegmenter* camera : cameras) {
        camera->upload_in_flight_ = false;
        if (camera->step_ == Step::kBegun) camera->step_ = Step::kLooked;
    }
    if (update) queue_update(stream_, set, count);
    for (const Member& member : members) member.segmenter->step_ = update ? Step::kUpdated : Step::kDecided;
}

void CudaSegmenter::decide_together(std::span<const FrameDecision> cameras) {
    std::vector<Member> members;
    for (const FrameDecision& camera : cameras) {
        auto* const segmenter = dynamic_cast<CudaSegmenter*>(camera.segmenter);
        if (!segmenter || segmenter->step_ != Step::kBegun || segmenter->context_ != context_ ||
            segmenter->data_.channels != data_.channels)
            return;  // each decides alone
        members.push_back({segmenter, {}});
        for (const Segmenter* other : camera.others)
            if (CudaSegmenter* const seen = segmenter->usable(other);
                seen && members.back().others.size() < kde::kMaxFloorViews)
                members.back().others.push_back(seen);
    }
    if (members.empty()) return;
    members.front().segmenter->decide_all(members, true);
}

void CudaSegmenter::decide(std::span<const Segmenter* const> others, Silhouettes& out) {
    if (step_ == Step::kBegun || step_ == Step::kLooked) {
        Member alone{this, {}};
        for (const Segmenter* other : others)
            if (CudaSegmenter* const seen = usable(other); seen && alone.others.size() < kde::kMaxFloorViews)
                alone.others.push_back(seen);
        decide_all({alone}, false);
    }
    results_.unpack(data_, searched_, out);
    if (results_.result().found && options_.colour_memory_weight > 0) {
        counts_.assign(results_.counts(), results_.counts() + colours_.bins());
        colours_.add(counts_, kColourMemory);
    }
}

// The masks are still on the device.
void CudaSegmenter::end_frame(const Silhouettes&) {
    if (step_ == Step::kDecided && data_.interval > 0) {
        stream_.use();
        CudaSegmenter* const own[] = {this};
        queue_update(stream_, upload_cameras(own), 1);
    }
    step_ = Step::kNone;
    ++frame_;
}

}  // namespace
}  // namespace cuda

std::shared_ptr<DeviceContext> make_device_context_cuda(int gpu) {
    cuda::require_gpu("segmentation", gpu);
    return std::make_shared<cuda::CudaContext>(gpu);
}

std::unique_ptr<Segmenter> make_segmenter_cuda(int gpu, int width, int height, int channels,
                                               const SegmentationOptions& options,
                                               std::shared_ptr<DeviceContext> context) {
    cuda::require_gpu("segmentation", gpu);
    auto own = std::dynamic_pointer_cast<cuda::CudaContext>(std::move(context));
    if (!own || own->stream.gpu() != gpu)
        throw std::invalid_argument("segmentation: the context is not that of " + name_of(Device::cuda(gpu)));
    return std::make_unique<cuda::CudaSegmenter>(width, height, channels, options, std::move(own));
}

}  // namespace kinevox::kernels
