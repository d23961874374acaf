#include "server/pipeline/pipeline.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <atomic>
#include <exception>
#include <limits>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <utility>

#include "common/stopwatch.h"
#include "kernels/projection.h"
#include "server/pipeline/convert.h"
#include "server/pipeline/for_each_camera.h"
#include "server/pipeline/pipeline_resources.h"
#include "server/pipeline/tracking/cone_box.h"
#include "server/pipeline/tracking/subject_tracker.h"
#include "server/pose/pose_stage.h"
#include "server/silhouettes/mask_box.h"

namespace kinevox {
namespace {

constexpr int kExpectedDilation = 40;  // 1/40 of the image height

constexpr float kMaxHidden = 0.15f;  // of a subject by nearer ones, in a view that colours it

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

// What the segmentation expects to see of a subject.
struct ExpectedShape {
    std::uint32_t subject_id = 0;
    kernels::VoxelVolume coarse;  // of the last frame set that showed it
    std::optional<Box3> legs;     // the space of legs that it lacks, in the world frame
    Vec3 motion;                  // since then, m
};

// The segmentation compares components and holes with the largest component: the nearest of several people,
// who may be twice as near, and so four times as large, as the others.
PipelineOptions for_several(PipelineOptions options) {
    constexpr float kAreaRatio = 4;
    if (!options.tracker.one_person()) {
        options.segmentation.min_component_fraction /= kAreaRatio;
        options.segmentation.max_hole_fraction /= kAreaRatio;
    }
    return options;
}

class StagedPipeline final : public Pipeline {
  public:
    StagedPipeline(std::vector<Camera> cameras, double fps, const PipelineOptions& options)
        : cameras_(std::move(cameras)),
          fps_(fps),
          options_(for_several(options)),
          device_(cameras_, options_),
          control_(std::make_shared<SubjectControl>(options.tracker.max_subjects)),
          tracker_(cameras_, fps, tracker_options(options), *control_) {
        for (const Camera& camera : cameras_) models_.push_back(to_kernel(camera));
        expected_.resize(cameras_.size());
        another_.resize(cameras_.size());
        make_pose_lanes();
    }

    absl::Status learn_background(const std::vector<std::vector<Image>>& empty_scene) override;
    absl::StatusOr<std::unique_ptr<Reconstruction>> reconstruct(FrameSet frame_set) override;
    absl::StatusOr<FrameResultPtr> pose(std::unique_ptr<Reconstruction> reconstruction) override;
    void set_judge_faint(bool judge) override { judge_faint_ = judge; }
    void reset_track() override {
        tracker_.reset();
        shapes_.clear();
        track_forgotten_ = true;
    }
    absl::Status forget_frames();
    void set_cameras(std::vector<Camera> cameras) override;
    PoseStage* pose_stage() override { return pose_lanes_.empty() ? nullptr : pose_lanes_[0].stage.get(); }
    PoseStage* pose_stage_of(std::uint32_t subject_id) override;
    std::shared_ptr<SubjectControl> subject_control() override { return control_; }

  private:
    static TrackerOptions tracker_options(const PipelineOptions& options) {
        TrackerOptions tracker = options.tracker;
        tracker.voxel_m = options.voxel_m;
        return tracker;
    }

    absl::Status check_image(const Image& image, std::size_t camera) const;
    void make_pose_lanes();
    kernels::SegmentationPrior expectation(std::size_t camera, const kernels::SegmentationPrior& tracked);
    void segment(FrameResult& result);
    void track(FrameResult& result);
    void reconstruct_subjects(Reconstruction& work, Stopwatch& timer);
    void carve(const FrameResult& result, const SceneSubject& subject, SubjectReconstruction& work);
    void carve_with(Stages& stages, const SceneSubject& subject, SubjectReconstruction& work);
    kernels::HullCarver& carver_of(Stages& stages) const;
    bool colours_hull_at_once(const Stages& stages) const;
    void separate(Reconstruction& work);
    void colour(const FrameResult& result, const SceneSubject& tracked, SubjectReconstruction& work,
                SubjectResult& subject);
    void finish_subject(const SceneSubject& tracked, SubjectReconstruction& work, SubjectResult& subject);
    absl::Status pose_subject(const FrameResult& result, const SubjectReconstruction& seen, PoseStage& stage,
                              SubjectResult& subject) const;
    absl::Status pose_subjects(Reconstruction& work);
    PoseStage& lane_of(const FrameResult& result, std::uint32_t subject_id);

    // Of both halves.
    std::vector<Camera> cameras_;
    const double fps_;
    PipelineOptions options_;
    std::vector<kernels::CameraModel> models_;
    SpareReconstructions spare_;

    std::atomic<bool> judge_faint_ = options_.segmentation.judge_faint;

    // Of the first half only.
    DeviceStages device_;
    std::shared_ptr<SubjectControl> control_;
    SubjectTracker tracker_;
    ResultPool results_;
    bool learned_ = false;
    bool track_forgotten_ = false;                     // since the last reconstruction
    std::vector<ExpectedShape> shapes_;                // of the subjects that the last frame set showed
    std::vector<std::vector<std::uint8_t>> expected_;  // per camera, their projection to where they should be
    std::vector<std::vector<std::uint8_t>> another_;   // per camera, that of one of them

    // Of the first half's current frame set; members, so that their memory is kept.
    std::vector<const kernels::Silhouettes*> seen_;  // per camera, null: no image
    std::vector<kernels::ImageView> images_;         // per camera
    std::vector<SceneSubject> tracked_;              // as result.subjects
    std::vector<kernels::HullView> hull_views_;
    std::vector<kernels::ColouringView> colouring_views_;
    kernels::ColouringReport report_;
    SubjectSeparator separator_;
    std::vector<Bystander> bystanders_;

    // Of the second half only.
    struct PoseLane {
        std::uint32_t subject_id = 0;
        std::unique_ptr<PoseStage> stage;
        std::int64_t last_time_ns = 0;
    };
    std::vector<PoseLane> pose_lanes_;  // empty without poses
    std::int64_t last_posed_ns_ = 0;    // time of the frame set before
};

void StagedPipeline::make_pose_lanes() {
    pose_lanes_.clear();
    if (!options_.pose) return;
    pose_lanes_.resize(static_cast<std::size_t>(options_.tracker.max_subjects));
    for (PoseLane& lane : pose_lanes_)
        lane.stage = std::make_unique<PoseStage>(cameras_, fps_, options_.posing);
}

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
    tracker_ = SubjectTracker(cameras_, fps_, tracker_options(options_), *control_);
    reset_track();
    for (PoseLane& lane : pose_lanes_) {
        const BodyInUse body = lane.stage->body_in_use();
        PoseProposer* const proposer = lane.stage->proposer();
        *lane.stage = PoseStage(cameras_, fps_, options_.posing);
        lane.stage->set_body(body);
        lane.stage->set_proposer(proposer);
    }
}

kernels::SegmentationPrior StagedPipeline::expectation(std::size_t camera,
                                                       const kernels::SegmentationPrior& tracked) {
    kernels::SegmentationPrior prior = tracked;
    if (shapes_.empty() || prior.region.empty()) return prior;
    if (tracker_.separates() && prior.full_pass)
        return prior;  // newcomers are apart from the expected shapes
    const Camera& c = cameras_[camera];
    // Limbs also move relative to the body; components need only touch the expected projection.
    const int dilate_px = std::max(1, c.height / kExpectedDilation);
    std::vector<std::uint8_t>& expected = expected_[camera];
    expected.resize(static_cast<std::size_t>(c.width) * c.height);
    for (std::size_t n = 0; n < shapes_.size(); ++n) {
        const Vec3 motion = shapes_[n].motion;
        const float moved[3] = {static_cast<float>(motion.x), static_cast<float>(motion.y),
                                static_cast<float>(motion.z)};
        std::vector<std::uint8_t>& mask = n == 0 ? expected : another_[camera];
        mask.resize(expected.size());
        kernels::Rect covered;
        kernels::project_volume(shapes_[n].coarse, models_[camera], moved, dilate_px, mask.data(), covered);
        if (n > 0) add_box(mask, c.width, covered, expected);
        if (shapes_[n].legs)
            fill_box(expected, c.width,
                     projected_box(
                         c, {shapes_[n].legs->min_in_world + motion, shapes_[n].legs->max_in_world + motion}),
                     255);
    }
    prior.expected = expected.data();
    if (prior.max_distance_px >= 0) prior.max_distance_px = std::max(prior.max_distance_px - dilate_px, 0);
    return prior;
}

void StagedPipeline::segment(FrameResult& result) {
    const auto priors = tracker_.predict(result.capture_time_ns);
    for (ExpectedShape& shape : shapes_) shape.motion = tracker_.motion(shape.subject_id);
    result.silhouettes.resize(cameras_.size());
    seen_.assign(cameras_.size(), nullptr);
    std::vector<std::size_t> seeing;  // cameras with an image
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        if (result.frame_set.images[c].empty())
            result.silhouettes[c] = {};
        else
            seeing.push_back(c);
    }
    const bool judge_faint = judge_faint_;
    device_.run([&](Stages& stages) {
        for_each_camera(seeing.size(), [&](std::size_t n) {
            const std::size_t c = seeing[n];
            stages.segmenters[c]->set_judge_faint(judge_faint);
            stages.segmenters[c]->begin_frame(to_kernel(result.frame_set.images[c]),
                                              expectation(c, priors[c]));
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
    tracked_.clear();
    images_.clear();
    for (const Image& image : result.frame_set.images) images_.push_back(to_kernel(image));
    SceneUpdate update = tracker_.update(result.sequence, result.capture_time_ns, seen_, images_);
    result.events = std::move(update.events);
    tracked_ = std::move(update.subjects);
    bystanders_ = std::move(update.bystanders);
    result.bystanders = static_cast<int>(bystanders_.size());
    for (const SceneSubject& tracked : tracked_) {
        SubjectResult& subject = result.subjects.emplace_back();
        subject.track = tracked.track;
        subject.silhouette_iou.assign(cameras_.size(), std::numeric_limits<float>::quiet_NaN());
    }
}

// Only inlier cameras carve the subject.
void StagedPipeline::carve(const FrameResult& result, const SceneSubject& subject,
                           SubjectReconstruction& work) {
    hull_views_.clear();
    work.inlier_cameras.clear();
    const Box3 box = box_of(*subject.lattice);
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        if (subject.roles[c] != CameraRole::kInlier && subject.roles[c] != CameraRole::kTruncated) continue;
        const kernels::Silhouettes& s = result.silhouettes[c];
        // Of several subjects' silhouettes only what the lattice can project to is prepared.
        const kernels::Rect bounds = tracker_.separates() ? cropped_to(s.bounds, cameras_[c], box) : s.bounds;
        hull_views_.push_back({&models_[c], s.loose.data(), bounds});
        work.inlier_cameras.push_back(c);
    }
    device_.run([&](Stages& stages) {
        work.hull_to_come = colours_hull_at_once(stages);
        if (!work.hull_to_come) carve_with(stages, subject, work);
    });
}

kernels::HullCarver& StagedPipeline::carver_of(Stages& stages) const {
    return *(hull_views_.size() >= kernels::kManyCameras ? stages.many_views_carver : stages.carver);
}

// Whether only the coloured volume is needed, so that a GPU keeps the hull to itself.
bool StagedPipeline::colours_hull_at_once(const Stages& stages) const {
    return stages.colourer && stages.colourer->carves_and_colours() && tracked_.size() == 1 &&
           !tracker_.separates() && !options_.keep_hulls;
}

void StagedPipeline::carve_with(Stages& stages, const SceneSubject& subject, SubjectReconstruction& work) {
    carver_of(stages).carve(hull_views_, *subject.lattice, work.volume);
    tracker_.restrict_to(subject.track.subject_id, work.volume);
}

// Of the subjects that this frame set shows, from each other and from bystanders.
void StagedPipeline::separate(Reconstruction& work) {
    for (std::size_t n = 0; n < tracked_.size(); ++n) work.subjects[n].beside_others = false;
    if (!tracker_.separates()) return;
    std::vector<const kernels::VoxelVolume*> shapes;
    std::vector<SubjectViews*> views;
    for (std::size_t n = 0; n < tracked_.size(); ++n) {
        if (!tracked_[n].lattice) continue;
        coarsen_by_four(work.subjects[n].volume, work.subjects[n].coarse);
        shapes.push_back(&work.subjects[n].coarse);
        views.push_back(&work.subjects[n].views);
    }
    if (shapes.empty()) return;
    for (const Bystander& bystander : bystanders_) {
        shapes.push_back(&bystander.shape);
        views.push_back(nullptr);
    }
    if (shapes.size() < 2) return;
    separator_.separate(cameras_, models_, work.result->silhouettes, shapes, views);
    for (std::size_t n = 0; n < tracked_.size(); ++n)
        work.subjects[n].beside_others = tracked_[n].lattice.has_value();
}

void StagedPipeline::colour(const FrameResult& result, const SceneSubject& tracked,
                            SubjectReconstruction& work, SubjectResult& subject) {
    // A nearer subject would lend its colours to this one.
    std::vector<std::size_t> showing;
    for (const std::size_t c : work.inlier_cameras)
        if (!work.beside_others || work.views.hidden_fraction[c] <= kMaxHidden) showing.push_back(c);
    if (showing.size() < 2) showing = work.inlier_cameras;
    colouring_views_.clear();
    for (const std::size_t c : showing) {
        const kernels::Silhouettes& s = work.beside_others ? work.views.own[c] : result.silhouettes[c];
        colouring_views_.push_back(
            {&models_[c], to_kernel(result.frame_set.images[c]), s.loose.data(), s.sharp.data(), s.bounds});
    }
    bool again = false;
    device_.run([&](Stages& stages) {
        for (std::size_t view = 0; view < showing.size(); ++view)
            colouring_views_[view].image_on_device =
                stages.segmenters[showing[view]]->image_on_device(colouring_views_[view].image);
        if (work.hull_to_come)
            return stages.colourer->carve_and_colour(carver_of(stages), hull_views_, *tracked.lattice,
                                                     colouring_views_, work.volume, report_);
        // Colouring changes the volume: carve again after a GPU failed in the middle of it.
        if (std::exchange(again, true)) carve_with(stages, tracked, work);
        stages.colourer->colour(colouring_views_, work.volume, report_);
    });
    for (std::size_t view = 0; view < showing.size() && view < report_.silhouette_iou.size(); ++view)
        subject.silhouette_iou[showing[view]] = report_.silhouette_iou[view];
}

void StagedPipeline::finish_subject(const SceneSubject& tracked, SubjectReconstruction& work,
                                    SubjectResult& subject) {
    static_assert(PoseStage::kCoarseFactor == 4);
    coarsen_by_four(work.volume, work.coarse);
    ExpectedShape& shape = shapes_.emplace_back(ExpectedShape{tracked.track.subject_id, work.coarse, {}, {}});
    if (const auto centre = centre_of(work.volume)) {
        shape.legs = missing_legs_space(*centre, legs_missing_below(work.volume));
        if (!tracker_.separates()) tracker_.observe_volume(*centre, shape.legs.has_value(), work.coarse);
    }
    subject.volume = std::make_shared<const Volume>(to_common(work.volume));
}

// From the hulls to the colours.
void StagedPipeline::reconstruct_subjects(Reconstruction& work, Stopwatch& timer) {
    FrameResult& result = *work.result;
    if (work.subjects.size() < tracked_.size()) work.subjects.resize(tracked_.size());
    shapes_.clear();
    for (const Bystander& bystander : bystanders_) shapes_.push_back({bystander.id, bystander.shape, {}, {}});
    if (std::ranges::none_of(tracked_, [](const SceneSubject& each) { return each.lattice.has_value(); }))
        return;
    for (std::size_t n = 0; n < tracked_.size(); ++n)
        if (tracked_[n].lattice) carve(result, tracked_[n], work.subjects[n]);
    separate(work);
    result.times.hull_ms = timer.lap_ms();
    for (std::size_t n = 0; n < tracked_.size(); ++n) {
        if (!tracked_[n].lattice) continue;
        if (options_.keep_hulls)
            result.subjects[n].hull = std::make_shared<const Volume>(to_common(work.subjects[n].volume));
        if (options_.colouring) {
            timer.lap_ms();  // the conversion of the subject before
            colour(result, tracked_[n], work.subjects[n], result.subjects[n]);
            result.times.colouring_ms += timer.lap_ms();
        }
        finish_subject(tracked_[n], work.subjects[n], result.subjects[n]);
    }
}

absl::StatusOr<std::unique_ptr<Reconstruction>> StagedPipeline::reconstruct(FrameSet frame_set) {
    const Stopwatch since_arrival;
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
    work->since_arrival = since_arrival;
    work->result = results_.take();
    work->first_of_track = std::exchange(track_forgotten_, false);
    FrameResult& result = *work->result;
    result.sequence = frame_set.sequence;
    result.capture_time_ns = frame_set.capture_time_ns;
    result.times.decode_ms = frame_set.decode_ms;
    result.frame_set = std::move(frame_set);
    try {
        Stopwatch timer;
        segment(result);
        result.times.segmentation_ms = timer.lap_ms();
        track(result);
        result.times.tracking_ms = timer.lap_ms();
        reconstruct_subjects(*work, timer);
    } catch (const std::exception& error) {
        return absl::InternalError(fmt::format("frame set {}: {}", result.sequence, error.what()));
    }
    if (options_.gpu)
        if (std::string message = options_.gpu->take_message(); !message.empty())
            result.events.push_back(
                {EventKind::kGpuFailed, result.sequence, result.capture_time_ns, {}, std::move(message)});
    return work;
}

PoseStage* StagedPipeline::pose_stage_of(std::uint32_t subject_id) {
    const auto lane = std::ranges::find(pose_lanes_, subject_id, &PoseLane::subject_id);
    return lane == pose_lanes_.end() ? nullptr : lane->stage.get();
}

// A new subject gets a lane whose subject is gone; one who returns keeps the body, not the posture.
PoseStage& StagedPipeline::lane_of(const FrameResult& result, std::uint32_t subject_id) {
    const auto known = std::ranges::find(pose_lanes_, subject_id, &PoseLane::subject_id);
    if (known != pose_lanes_.end()) {
        const double absent_s = 1e-9 * static_cast<double>(result.capture_time_ns - known->last_time_ns);
        const bool shown_before = known->last_time_ns == last_posed_ns_;
        known->last_time_ns = result.capture_time_ns;
        if (!shown_before && absent_s > options_.tracker.lost_after_s) known->stage->reset();
        return *known->stage;
    }
    PoseLane& lane = *std::ranges::find_if(pose_lanes_, [&](const PoseLane& each) {
        return std::ranges::none_of(result.subjects, [&](const SubjectResult& subject) {
            return subject.track.subject_id == each.subject_id;
        });
    });
    const bool first_use = std::exchange(lane.subject_id, subject_id) == 0;
    if (!first_use && options_.tracker.several_subjects())
        lane.stage->set_body(options_.posing.initial_body());
    lane.last_time_ns = result.capture_time_ns;
    lane.stage->reset();
    lane.stage->set_proposer(pose_lanes_.front().stage->proposer());
    return *lane.stage;
}

// An outlier camera would distort the pose, so only the carving cameras are used.
absl::Status StagedPipeline::pose_subject(const FrameResult& result, const SubjectReconstruction& seen,
                                          PoseStage& stage, SubjectResult& subject) const {
    std::vector<PoseView> views(cameras_.size());
    for (std::size_t c = 0; c < cameras_.size(); ++c) views[c].camera = &models_[c];
    for (const std::size_t c : seen.inlier_cameras) {
        views[c].image = to_kernel(result.frame_set.images[c]);
        views[c].silhouettes = seen.beside_others ? &seen.views.own[c] : &result.silhouettes[c];
        if (seen.beside_others) views[c].shared = &seen.views.shared[c];
    }
    try {
        subject.pose = stage.process(subject.track.subject_id, result.sequence, result.capture_time_ns, views,
                                     seen.volume, seen.coarse, subject.track.centre_in_world);
    } catch (const std::exception& error) {
        return absl::InternalError(fmt::format("frame set {}: {}", result.sequence, error.what()));
    }
    return absl::OkStatus();
}

// The subjects in parallel, because a pose stage alone does not keep many threads busy.
absl::Status StagedPipeline::pose_subjects(Reconstruction& work) {
    FrameResult& result = *work.result;
    std::vector<std::size_t> shown;
    std::vector<PoseStage*> stages;
    for (std::size_t n = 0; n < result.subjects.size(); ++n) {
        if (!result.subjects[n].volume) continue;
        shown.push_back(n);
        stages.push_back(&lane_of(result, result.subjects[n].track.subject_id));
    }
    std::vector<absl::Status> posed(shown.size());
    const auto pose_one = [&](std::size_t n) {
        SubjectResult& subject = result.subjects[shown[n]];
        posed[n] = pose_subject(result, work.subjects[shown[n]], *stages[n], subject);
    };
    // Isolated: a thread that waits inside a pose stage must not begin another subject.
    oneapi::tbb::parallel_for(
        std::size_t{0}, shown.size(),
        [&](std::size_t n) { oneapi::tbb::this_task_arena::isolate([&] { pose_one(n); }); },
        oneapi::tbb::simple_partitioner());
    for (absl::Status& each : posed)
        if (!each.ok()) return std::move(each);
    return absl::OkStatus();
}

absl::StatusOr<FrameResultPtr> StagedPipeline::pose(std::unique_ptr<Reconstruction> work) {
    const std::shared_ptr<FrameResult> result = work->result;
    if (work->first_of_track)
        for (PoseLane& lane : pose_lanes_) lane.stage->reset();
    if (!pose_lanes_.empty()) {
        Stopwatch timer;
        if (absl::Status posed = pose_subjects(*work); !posed.ok()) return posed;
        last_posed_ns_ = result->capture_time_ns;
        result->times.pose_ms = timer.lap_ms();
    }
    result->times.total_ms = work->since_arrival.ms();
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
