#include "server/calibration/procedure/camera_watch.h"

#include <fmt/format.h>
#include <oneapi/tbb/task_arena.h>

#include <algorithm>
#include <utility>

#include "common/background_priority.h"

namespace kinevox {
namespace {

constexpr double kMaxFraction =
    0.5;  // of the image: more is not the subject but the foreground of a moved camera

// The subject in a camera's image, px: the projection of its volume or, without one, the camera's foreground.
// A moved camera's foreground is the whole scene, which must not hide the movement.
kernels::Rect subject_box(const FrameResult& result, std::size_t c, const Camera& camera) {
    kernels::Rect box{camera.width, camera.height, 0, 0};
    if (result.volume) {
        const VolumeGrid& grid = result.volume->grid;
        for (int corner = 0; corner < 8; ++corner) {
            const Vec3 along{grid.voxel_m * grid.size[0] * (corner & 1),
                             grid.voxel_m * grid.size[1] * (corner >> 1 & 1),
                             grid.voxel_m * grid.size[2] * (corner >> 2)};
            const auto pixel = camera.project(grid.origin_in_world + along);
            if (!pixel) continue;
            box = {std::min(box.x0, static_cast<int>(std::clamp(pixel->x, 0.0, camera.width - 1.0))),
                   std::min(box.y0, static_cast<int>(std::clamp(pixel->y, 0.0, camera.height - 1.0))),
                   std::max(box.x1, static_cast<int>(std::clamp(pixel->x, 0.0, camera.width - 1.0)) + 1),
                   std::max(box.y1, static_cast<int>(std::clamp(pixel->y, 0.0, camera.height - 1.0)) + 1)};
        }
    } else if (c < result.silhouettes.size()) {
        box = result.silhouettes[c].bounds;
    }
    const double area = static_cast<double>(box.x1 - box.x0) * (box.y1 - box.y0);
    const bool usable =
        box.x0 < box.x1 && box.y0 < box.y1 && area < kMaxFraction * camera.width * camera.height;
    return usable ? box : kernels::Rect{};
}

}  // namespace

CameraMotionState::Change CameraMotionState::add(const std::optional<SceneShift>& shift,
                                                 const std::string& camera,
                                                 const CameraWatchOptions& options) {
    if (!shift) return Change::kNone;
    camera_.shift_px = shift->shift_px;
    const bool moved = shift->rotation_deg >= options.suspect_deg && shift->explained >= options.explained;
    const bool restored = shift->rotation_deg <= options.restored_deg;
    moved_in_a_row_ = moved ? moved_in_a_row_ + 1 : 0;
    restored_in_a_row_ = restored ? restored_in_a_row_ + 1 : 0;
    const bool was = camera_.suspect;
    if (moved_in_a_row_ >= options.confirmations) camera_.suspect = true;
    if (restored_in_a_row_ >= options.confirmations) camera_.suspect = false;
    if (!camera_.suspect)
        camera_.reason.clear();
    else if (moved)
        camera_.reason = fmt::format(
            "camera {} has moved: it has rotated by {:.1f} degrees since the capture began; put it back, or "
            "relearn the background and run kinevox calibrate refine",
            camera, shift->rotation_deg);
    if (camera_.suspect == was) return Change::kNone;
    return camera_.suspect ? Change::kMoved : Change::kRestored;
}

CameraWatch::CameraWatch(std::vector<Camera> cameras, const CameraWatchOptions& options, OnEvent on_event)
    : options_(options),
      on_event_(std::move(on_event)),
      cameras_(std::move(cameras)),
      verdicts_(cameras_.size()) {
    worker_ = std::thread([this] { watch_loop(); });
}

CameraWatch::~CameraWatch() {
    close();
    worker_.join();
}

void CameraWatch::close() {
    const std::scoped_lock lock(mutex_);
    closed_ = true;
    changed_.notify_all();
}

void CameraWatch::reset(std::vector<Camera> cameras) {
    const std::scoped_lock lock(mutex_);
    cameras_ = std::move(cameras);
    restart_ = true;
}

std::vector<WatchedCamera> CameraWatch::cameras() const {
    const std::scoped_lock lock(mutex_);
    std::vector<WatchedCamera> out;
    for (const CameraMotionState& verdict : verdicts_) out.push_back(verdict.camera());
    return out;
}

void CameraWatch::observe(const FrameResult& result) {
    const bool restarted = last_ns_ && result.capture_time_ns < *last_ns_;
    if (last_ns_ && !restarted &&
        1e-9 * static_cast<double>(result.capture_time_ns - *last_ns_) < options_.interval_s)
        return;
    last_ns_ = result.capture_time_ns;
    const std::scoped_lock lock(mutex_);
    if (result.frame_set.images.size() != cameras_.size()) return;
    restart_ = restart_ || restarted;
    if (busy_ || closed_) return;  // the machine is loaded: skip one check
    Sample sample{result.sequence,
                  result.capture_time_ns,
                  std::exchange(restart_, false),
                  result.frame_set.images,
                  {},
                  {}};
    for (std::size_t c = 0; c < cameras_.size(); ++c)
        sample.ignored.push_back(subject_box(result, c, cameras_[c]));
    if (sample.restart) sample.cameras = cameras_;
    next_ = std::move(sample);
    busy_ = true;
    changed_.notify_all();
}

void CameraWatch::watch_loop() {
    lower_this_threads_priority();     // the capture comes first
    oneapi::tbb::task_arena alone(1);  // none of the pipeline's workers
    while (true) {
        std::unique_lock lock(mutex_);
        changed_.wait(lock, [&] { return closed_ || next_; });
        if (closed_) return;
        const Sample sample = *std::exchange(next_, std::nullopt);
        lock.unlock();
        alone.execute([&] { process(sample); });
        lock.lock();
        busy_ = false;
    }
}

void CameraWatch::process(const Sample& sample) {
    if (sample.restart) {
        scenes_.clear();
        names_.clear();
        for (const Camera& camera : sample.cameras)
            scenes_.emplace_back(camera), names_.push_back(camera.name);
        const std::scoped_lock lock(mutex_);
        verdicts_.assign(scenes_.size(), {});
    }
    for (std::size_t c = 0; c < scenes_.size(); ++c) {
        const auto shift = scenes_[c].measure(sample.images[c], sample.ignored[c]);
        CameraMotionState::Change change;
        std::string reason;
        {
            const std::scoped_lock lock(mutex_);
            if (closed_) return;
            change = verdicts_[c].add(shift, names_[c], options_);
            reason = verdicts_[c].camera().reason;
        }
        if (change == CameraMotionState::Change::kMoved)
            on_event_({EventKind::kCameraMoved, sample.sequence, sample.time_ns, names_[c], reason});
        if (change == CameraMotionState::Change::kRestored)
            on_event_(
                {EventKind::kCameraMoveCleared, sample.sequence, sample.time_ns, names_[c],
                 fmt::format("camera {} is back in its pose from the start of the capture", names_[c])});
    }
}

}  // namespace kinevox
