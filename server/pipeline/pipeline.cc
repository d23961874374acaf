#include "server/pipeline/pipeline.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <exception>
#include <limits>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <utility>

#include "kernels/projection.h"
#include "server/pipeline/convert.h"
#include "server/pipeline/for_each_camera.h"
#include "server/pipeline/pipeline_resources.h"
#include "server/pose/pose_stage.h"

namespace kinevox {
namespace {

constexpr int kExpectedDilation = 40;  // 1/40 of the image height

constexpr std::size_t kManyViews = 4;

using Clock = std::chrono::steady_clock;

double to_ms(Clock::duration time) {
    return std::chrono::duration<double, std::milli>(time).count();
}

// Milliseconds since the construction or the last call.
class LapTimer {
  public:
    double lap_ms() {
        const auto now = Clock::now();
        const double ms = to_ms(now - lap_);
        lap_ = now;
        return ms;
    }

  private:
    Clock::time_point lap_ = Clock::now();
};

// Reconstructions for reuse, so that the memory of their volumes is kept. Thread safe.
class SpareReconstructions {
  public:
    std::unique_ptr<Reconstruction> take() {
        const std::lock_guard lock(mutex_);
        if (spare_.empty()) return std::make_unique<Reconstruction>();
        std::unique_ptr<Reconstruction> taken = std::move(spare_.back());
        spare_.pop_back();
        return taken;
    }
    void give_back(std::unique_ptr<Reconstruction> used) {
        used->result.reset();
        const std::lock_guard lock(mutex_);
        if (spare_.size() < kMaxSpare) spare_.push_back(std::move(used));
    }

  private:
    static constexpr std::size_t kMaxSpare = 3;  // one in each half, one between
    std::mutex mutex_;
    std::vector<std::unique_ptr<Reconstruction>> spare_;
};

class StagedPipeline final : public Pipeline {
  public:
    StagedPipeline(std::vector<Camera> cameras, double fps, const PipelineOptions& options)
        : cameras_(std::move(cameras)),
          fps_(fps),
          options_(options),
          device_(cameras_, options),
          tracker_(cameras_, fps, tracker_options(options)) {
        for (const Camera& camera : cameras_) models_.push_back(to_kernel(camera));
        expected_.resize(cameras_.size());
        if (options.pose) pose_stage_.emplace(cameras_, fps, options.posing);
    }

    absl::Status learn_background(const std::vector<std::vector<Image>>& empty_scene) override;
    absl::StatusOr<std::unique_ptr<Reconstruction>> reconstruct(FrameSet frame_set) override;
    absl::StatusOr<FrameResultPtr> pose(std::unique_ptr<Reconstruction> reconstruction) override;
    void reset_track() override {
        tracker_.reset();
        expect_volume_ = false;
        track_forgotten_ = true;
    }
    absl::Status forget_frames();
    void set_cameras(std::vector<Camera> cameras) override;
    PoseStage* pose_stage() override { return pose_stage_ ? &*pose_stage_ : nullptr; }

  private:
    static TrackerOptions tracker_options(const PipelineOptions& options) {
        TrackerOptions tracker = options.tracker;
        tracker.voxel_m = options.voxel_m;
        return tracker;
    }

    absl::Status check_image(const Image& image, std::size_t camera) const;
    kernels::SegmentationPrior expectation(std::size_t camera, const kernels::SegmentationPrior& tracked,
                                           const Vec3& motion);
    void segment(FrameResult& result);
    void track(FrameResult& result);
    void carve(Reconstruction& work);
    void carve_with(Stages& stages, Reconstruction& work);
    void colour(Reconstruction& work);

    // Of both halves.
    std::vector<Camera> cameras_;
    const double fps_;
    PipelineOptions options_;
    std::vector<kernels::CameraModel> models_;
    SpareReconstructions spare_;

    // Of the first half only.
    DeviceStages device_;
    Tracker tracker_;
    ResultPool results_;
    bool learned_ = false;
    bool track_forgotten_ = false;                     // since the last reconstruction
    bool expect_volume_ = false;                       // the next line is of the last frame set's subject
    kernels::VoxelVolume last_shape_;                  // coarse
    std::vector<std::vector<std::uint8_t>> expected_;  // per camera, its projection to where it should be now

    // Of the first half's current frame set; members, so that their memory is kept.
    std::vector<const kernels::Silhouettes*> seen_;  // per camera, null: no image
    TrackerUpdate update_;
    std::vector<kernels::HullView> hull_views_;
    std::vector<kernels::ColouringView> colouring_views_;
    kernels::ColouringReport report_;

    // Of the second half only.
    std::optional<PoseStage> pose_stage_;  // empty without poses
    std::vector<PoseView> pose_views_;
    std::uint32_t posed_subject_ = 0;
};

absl::Status StagedPipeline::check_image(const Image& image, std::size_t camera) const {
    const Camera& c = cameras_[camera];
    if (image.width == c.width && image.height == c.height && image.channels == 3) return absl::OkStatus();
    return absl::InvalidArgumentError(fmt::format(
        "camera {}: an image of {} x {} px with {} channels does not match its calibration of {} x {} px "
        "(3 channels); set the camera's format or recalibrate it",
        c.name, image.width, image.height, image.channels, c.width, c.height));
}

absl::Status StagedPipeline::learn_background(const std::vector<std::vector<Image>>& empty_scene) {
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        if (c >= empty_scene.size() || empty_scene[c].empty())
            return absl::InvalidArgumentError(
                fmt::format("camera {} has no background image; record one (`background` in the session "
                            "file) or learn the "
                            "background live",
                            cameras_[c].name));
        for (const Image& image : empty_scene[c])
            if (absl::Status checked = check_image(image, c); !checked.ok()) return checked;
    }
    try {
        std::vector<std::vector<kernels::ImageView>> views(cameras_.size());
        for (std::size_t c = 0; c < cameras_.size(); ++c)
            for (const Image& image : empty_scene[c]) views[c].push_back(to_kernel(image));
        device_.learn(views);
    } catch (const std::exception& error) {
        return absl::InternalError(fmt::format("learning the background failed: {}", error.what()));
    }
    learned_ = true;
    reset_track();
    return absl::OkStatus();
}

// The state after learn_background().
absl::Status StagedPipeline::forget_frames() {
    if (!options_.allow_discontinuities)
        return absl::FailedPreconditionError(
            "a frame set does not follow the previous one, and this pipeline allows no discontinuities");
    device_.forget_frames();
    reset_track();
    return absl::OkStatus();
}

void StagedPipeline::set_cameras(std::vector<Camera> cameras) {
    cameras_ = std::move(cameras);
    for (std::size_t c = 0; c < cameras_.size(); ++c) models_[c] = to_kernel(cameras_[c]);
    device_.set_cameras(cameras_);
    tracker_ = Tracker(cameras_, fps_, tracker_options(options_));
    reset_track();
    if (!pose_stage_) return;
    const BodyShape body = pose_stage_->body();
    const double standing_m = pose_stage_->standing_m();
    PoseProposer* const proposer = pose_stage_->proposer();
    pose_stage_.emplace(cameras_, fps_, options_.posing);
    pose_stage_->set_body(body, standing_m);
    pose_stage_->set_proposer(proposer);
}

kernels::SegmentationPrior StagedPipeline::expectation(std::size_t camera,
                                                       const kernels::SegmentationPrior& tracked,
                                                       const Vec3& motion) {
    kernels::SegmentationPrior prior = tracked;
    if (!expect_volume_ || prior.region.empty()) return prior;
    const Camera& c = cameras_[camera];
    const float moved[3] = {static_cast<float>(motion.x), static_cast<float>(motion.y),
                            static_cast<float>(motion.z)};
    // Limbs also move relative to the body; components need only touch the expected projection.
    const int dilate_px = std::max(1, c.height / kExpectedDilation);
    kernels::Rect ignored;
    expected_[camera].resize(static_cast<std::size_t>(c.width) * c.height);
    kernels::project_volume(last_shape_, models_[camera], moved, dilate_px, expected_[camera].data(),
                            ignored);
    prior.expected = expected_[camera].data();
    if (prior.max_distance_px >= 0) prior.max_distance_px = std::max(prior.max_distance_px - dilate_px, 0);
    return prior;
}

void StagedPipeline::segment(FrameResult& result) {
    Vec3 motion;
    const auto priors = tracker_.predict(result.capture_time_ns, &motion);
    result.silhouettes.resize(cameras_.size());
    seen_.assign(cameras_.size(), nullptr);
    std::vector<std::size_t> seeing;  // cameras with an image
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        if (result.frame_set.images[c].empty())
            result.silhouettes[c] = {};
        else
            seeing.push_back(c);
    }
    device_.run([&](Stages& stages) {
        for_each_camera(seeing.size(), [&](std::size_t n) {
            const std::size_t c = seeing[n];
            stages.segmenters[c]->begin_frame(to_kernel(result.frame_set.images[c]),
                                              expectation(c, priors[c], motion));
        });
        // Shadows are compared between the cameras, so no model changes before all have decided.
        std::vector<kernels::FrameDecision> decisions(seeing.size());
        for (std::size_t n = 0; n < seeing.size(); ++n) {
            decisions[n].segmenter = stages.segmenters[seeing[n]].get();
            for (const std::size_t c : stages.floor_views[seeing[n]])
                if (!result.frame_set.images[c].empty())
                    decisions[n].others.push_back(stages.segmenters[c].get());
        }
        if (!decisions.empty()) decisions.front().segmenter->decide_together(decisions);
        for_each_camera(seeing.size(), [&](std::size_t n) {
            stages.segmenters[seeing[n]]->decide(decisions[n].others, result.silhouettes[seeing[n]]);
        });
        for_each_camera(seeing.size(), [&](std::size_t n) {
            stages.segmenters[seeing[n]]->end_frame(result.silhouettes[seeing[n]]);
        });
    });
    for (const std::size_t c : seeing) seen_[c] = &result.silhouettes[c];
}

void StagedPipeline::track(FrameResult& result) {
    update_ = tracker_.update(result.sequence, result.capture_time_ns, seen_);
    result.subject = update_.subject;
    result.events = std::move(update_.events);
}

// Only inlier cameras carve the subject. With four or more, voxels that only two of them see are removed:
// behind the borders of the other images, the cones of two opposite cameras intersect in a long ghost.
void StagedPipeline::carve(Reconstruction& work) {
    hull_views_.clear();
    work.inlier_cameras.clear();
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        if (update_.roles[c] != CameraRole::kInlier && update_.roles[c] != CameraRole::kTruncated) continue;
        const kernels::Silhouettes& s = work.result->silhouettes[c];
        hull_views_.push_back({&models_[c], s.loose.data(), s.bounds});
        work.inlier_cameras.push_back(c);
    }
    device_.run([&](Stages& stages) { carve_with(stages, work); });
}

void StagedPipeline::carve_with(Stages& stages, Reconstruction& work) {
    const bool many = hull_views_.size() >= kManyViews;
    (many ? stages.many_views_carver : stages.carver)->carve(hull_views_, *update_.lattice, work.volume);
}

void StagedPipeline::colour(Reconstruction& work) {
    FrameResult& result = *work.result;
    colouring_views_.clear();
    for (const std::size_t c : work.inlier_cameras) {
        const kernels::Silhouettes& s = result.silhouettes[c];
        colouring_views_.push_back(
            {&models_[c], to_kernel(result.frame_set.images[c]), s.loose.data(), s.sharp.data(), s.bounds});
    }
    bool again = false;
    device_.run([&](Stages& stages) {
        // Colouring changes the volume: carve again after a GPU failed in the middle of it.
        if (std::exchange(again, true)) carve_with(stages, work);
        stages.colourer->colour(colouring_views_, work.volume, report_);
    });
    for (std::size_t view = 0; view < work.inlier_cameras.size() && view < report_.silhouette_iou.size();
         ++view)
        result.silhouette_iou[work.inlier_cameras[view]] = report_.silhouette_iou[view];
}

absl::StatusOr<std::unique_ptr<Reconstruction>> StagedPipeline::reconstruct(FrameSet frame_set) {
    const Clock::time_point arrived = Clock::now();
    if (!learned_)
        return absl::FailedPreconditionError(
            "the background is not learned; learn it with the scene empty first");
    if (frame_set.images.size() != cameras_.size())
        return absl::InvalidArgumentError(fmt::format("frame set {} has {} images for {} cameras",
                                                      frame_set.sequence, frame_set.images.size(),
                                                      cameras_.size()));
    for (std::size_t c = 0; c < cameras_.size(); ++c)
        if (!frame_set.images[c].empty())
            if (absl::Status checked = check_image(frame_set.images[c], c); !checked.ok()) return checked;

    if (frame_set.after_discontinuity)
        if (absl::Status forgotten = forget_frames(); !forgotten.ok()) return forgotten;
    std::unique_ptr<Reconstruction> work = spare_.take();
    work->arrived = arrived;
    work->result = results_.take();
    work->first_of_track = std::exchange(track_forgotten_, false);
    FrameResult& result = *work->result;
    result.sequence = frame_set.sequence;
    result.capture_time_ns = frame_set.capture_time_ns;
    result.times.decode_ms = frame_set.decode_ms;
    result.frame_set = std::move(frame_set);
    result.silhouette_iou.assign(cameras_.size(), std::numeric_limits<float>::quiet_NaN());
    try {
        LapTimer timer;
        segment(result);
        result.times.segmentation_ms = timer.lap_ms();
        track(result);
        result.times.tracking_ms = timer.lap_ms();
        expect_volume_ = update_.lattice.has_value();
        if (update_.lattice) {
            carve(*work);
            result.times.hull_ms = timer.lap_ms();
            if (options_.colouring) {
                colour(*work);
                result.times.colouring_ms = timer.lap_ms();
            }
            static_assert(PoseStage::kCoarseFactor == 4);
            coarsen_by_four(work->volume, work->coarse);
            last_shape_ = work->coarse;
            if (const auto centre = centre_of(work->volume))
                tracker_.observe_volume(*centre, *bottom_of(work->volume));
            result.volume = std::make_shared<const Volume>(to_common(work->volume));
        }
    } catch (const std::exception& error) {
        return absl::InternalError(fmt::format("frame set {}: {}", result.sequence, error.what()));
    }
    if (options_.gpu)
        if (std::string message = options_.gpu->take_message(); !message.empty())
            result.events.push_back(
                {EventKind::kGpuFailed, result.sequence, result.capture_time_ns, {}, std::move(message)});
    return work;
}

// An outlier camera would distort the pose, so only the carving cameras are used.
absl::StatusOr<FrameResultPtr> StagedPipeline::pose(std::unique_ptr<Reconstruction> work) {
    const std::shared_ptr<FrameResult> result = work->result;
    if (work->first_of_track && pose_stage_) pose_stage_->reset();
    if (pose_stage_ && result->volume && result->subject) {
        LapTimer timer;
        const SubjectTrack& subject = *result->subject;
        if (subject.subject_id != posed_subject_) pose_stage_->reset();
        posed_subject_ = subject.subject_id;
        pose_views_.assign(cameras_.size(), {});
        for (std::size_t c = 0; c < cameras_.size(); ++c) pose_views_[c].camera = &models_[c];
        for (const std::size_t c : work->inlier_cameras) pose_views_[c].silhouettes = &result->silhouettes[c];
        try {
            result->pose =
                pose_stage_->process(subject.subject_id, result->sequence, result->capture_time_ns,
                                     pose_views_, work->volume, work->coarse, subject.centre_in_world);
        } catch (const std::exception& error) {
            return absl::InternalError(fmt::format("frame set {}: {}", result->sequence, error.what()));
        }
        result->times.pose_ms = timer.lap_ms();
    }
    result->times.total_ms = to_ms(Clock::now() - work->arrived);
    spare_.give_back(std::move(work));
    return result;
}

}  // namespace

std::string PipelineOptions::check() const {
    TrackerOptions with_voxel = tracker;
    with_voxel.voxel_m = voxel_m;
    for (std::string problem :
         {with_voxel.check(), segmentation.check(), hull.check(), colour.check(), posing.check()})
        if (!problem.empty()) return problem;
    return {};
}

absl::StatusOr<FrameResultPtr> Pipeline::process(FrameSet frame_set) {
    absl::StatusOr<std::unique_ptr<Reconstruction>> reconstruction = reconstruct(std::move(frame_set));
    if (!reconstruction.ok()) return reconstruction.status();
    return pose(*std::move(reconstruction));
}

absl::StatusOr<std::unique_ptr<Pipeline>> Pipeline::create(std::vector<Camera> cameras, double fps,
                                                           const PipelineOptions& options) {
    if (const std::string problem = options.check(); !problem.empty())
        return absl::InvalidArgumentError(problem);
    if (cameras.size() < 2)
        return absl::InvalidArgumentError(
            fmt::format("{} cameras; a volume needs at least 2 that see the subject", cameras.size()));
    if (!(fps > 0))
        return absl::InvalidArgumentError(
            fmt::format("{} frame sets per second; the rate must be positive", fps));
    try {
        return std::make_unique<StagedPipeline>(std::move(cameras), fps, options);
    } catch (const std::invalid_argument& error) {
        return absl::InvalidArgumentError(error.what());
    } catch (const std::exception& error) {
        return absl::FailedPreconditionError(error.what());
    }
}

}  // namespace kinevox
