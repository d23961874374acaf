#include "server/calibration/camera_watch.h"

#include <fmt/format.h>
#include <oneapi/tbb/task_arena.h>

#include <utility>

#include "common/background_priority.h"

namespace kinevox {

CameraVerdict::Change CameraVerdict::add(const std::optional<SceneShift>& shift, const std::string& camera,
                                         const CameraWatchOptions& options) {
    if (!shift) return Change::kNone;
    camera_.shift_px = shift->shift_px;
    const bool moved = shift->turn_deg >= options.suspect_deg && shift->explained >= options.explained;
    const bool in_place = shift->turn_deg <= options.in_place_deg;
    moved_in_a_row_ = moved ? moved_in_a_row_ + 1 : 0;
    in_place_in_a_row_ = in_place ? in_place_in_a_row_ + 1 : 0;
    const bool was = camera_.suspect;
    if (moved_in_a_row_ >= options.confirmations) camera_.suspect = true;
    if (in_place_in_a_row_ >= options.confirmations) camera_.suspect = false;
    if (!camera_.suspect)
        camera_.reason.clear();
    else if (moved)
        camera_.reason = fmt::format(
            "camera {} was knocked: it has turned by {:.1f} degrees since the capture began; put it back, or learn the "
            "background again and calibrate with kinevox calibrate refine",
            camera, shift->turn_deg);
    if (camera_.suspect == was) return Change::kNone;
    return camera_.suspect ? Change::kMoved : Change::kInPlace;
}

CameraWatch::CameraWatch(std::vector<Camera> cameras, const CameraWatchOptions& options, OnEvent on_event)
    : cameras_(std::move(cameras)), options_(options), on_event_(std::move(on_event)), verdicts_(cameras_.size()) {
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

void CameraWatch::begin_anew() {
    const std::scoped_lock lock(mutex_);
    anew_ = true;
}

std::vector<WatchedCamera> CameraWatch::cameras() const {
    const std::scoped_lock lock(mutex_);
    std::vector<WatchedCamera> out;
    for (const CameraVerdict& verdict : verdicts_) out.push_back(verdict.camera());
    return out;
}

void CameraWatch::observe(const FrameResult& result) {
    const bool anew = last_ns_ && result.capture_time_ns < *last_ns_;
    if (last_ns_ && !anew && 1e-9 * static_cast<double>(result.capture_time_ns - *last_ns_) < options_.interval_s)
        return;
    last_ns_ = result.capture_time_ns;
    if (result.frame_set.pictures.size() != cameras_.size()) return;
    const std::scoped_lock lock(mutex_);
    anew_ = anew_ || anew;
    if (busy_ || closed_) return;  // the machine is loaded: one look less
    Look look{result.sequence, result.capture_time_ns, std::exchange(anew_, false), result.frame_set.pictures, {}};
    look.ignored.resize(cameras_.size());
    for (std::size_t c = 0; c < cameras_.size() && c < result.silhouettes.size(); ++c)
        look.ignored[c] = result.silhouettes[c].bounds;
    next_ = std::move(look);
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
        const Look look = *std::exchange(next_, std::nullopt);
        lock.unlock();
        alone.execute([&] { look_at(look); });
        lock.lock();
        busy_ = false;
    }
}

void CameraWatch::look_at(const Look& look) {
    if (look.anew) {
        scenes_.clear();
        for (const Camera& camera : cameras_) scenes_.emplace_back(camera);
        const std::scoped_lock lock(mutex_);
        verdicts_.assign(cameras_.size(), {});
    }
    for (std::size_t c = 0; c < cameras_.size(); ++c) {
        const auto shift = scenes_[c].measure(look.pictures[c], look.ignored[c]);
        CameraVerdict::Change change;
        std::string reason;
        {
            const std::scoped_lock lock(mutex_);
            if (closed_) return;
            change = verdicts_[c].add(shift, cameras_[c].name, options_);
            reason = verdicts_[c].camera().reason;
        }
        if (change == CameraVerdict::Change::kMoved)
            on_event_({EventKind::kCameraMoved, look.sequence, look.time_ns, cameras_[c].name, reason});
        if (change == CameraVerdict::Change::kInPlace)
            on_event_({EventKind::kCameraInPlace, look.sequence, look.time_ns, cameras_[c].name,
                       fmt::format("camera {} looks where it looked when the capture began", cameras_[c].name)});
    }
}

}  // namespace kinevox
