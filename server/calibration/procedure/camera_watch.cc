#include "server/calibration/procedure/camera_watch.h"

#include <fmt/format.h>
#include <oneapi/tbb/task_arena.h>

#include <Eigen/Dense>
#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <utility>
#include <vector>

#include "common/background_priority.h"
#include "common/geometry.h"
#include "server/cameras/image_mat.h"

namespace kinevox {
namespace {

constexpr int kWidths_px[] = {80, 160, 320};  // of the longer side: coarse to fine
constexpr int kRounds = 8;
constexpr double kNoise_grey = 6;             // larger differences are down-weighted
constexpr double kMinVisibleFraction = 0.15;  // of the image
constexpr double kShadowFraction = 0.03;      // of the longer side, around the subject: shadows, motion
constexpr double kStillRotation_deg = 0.1;  // up to which newly visible regions are added to the first image

using Vector5 = Eigen::Matrix<double, 5, 1>;
using Matrix5 = Eigen::Matrix<double, 5, 5>;

// Grey, smoothed, without NaN. `seen`: 255 where the scene is visible.
struct Level {
    cv::Mat grey, seen;
};

// Grey, as large as the finest level.
cv::Mat reduced(const Image& image) {
    const cv::Mat whole = as_mat(image);
    const double scale =
        static_cast<double>(kWidths_px[std::size(kWidths_px) - 1]) / std::max(image.width, image.height);
    cv::Mat small;
    cv::resize(whole, small, {}, scale, scale, cv::INTER_AREA);
    if (image.channels == 3) cv::cvtColor(small, small, cv::COLOR_BGR2GRAY);
    return small;
}

// `finest`: from reduced(). `ignored`: px of the original image; `longer_px`: of the level.
Level level_of(const cv::Mat& finest, const Image& image, const kernels::Rect& ignored, int longer_px) {
    const double scale = static_cast<double>(longer_px) / std::max(image.width, image.height);
    Level level;
    const double fraction = static_cast<double>(longer_px) / kWidths_px[std::size(kWidths_px) - 1];
    cv::Mat small;
    cv::resize(finest, small, {}, fraction, fraction, cv::INTER_AREA);
    small.convertTo(level.grey, CV_32F);
    cv::GaussianBlur(level.grey, level.grey, {5, 5}, 1.2);
    level.seen = cv::Mat(level.grey.size(), CV_8U, cv::Scalar(255));
    if (!ignored.empty()) {
        const double margin = kShadowFraction * longer_px;
        const cv::Point from(static_cast<int>(scale * ignored.x0 - margin),
                             static_cast<int>(scale * ignored.y0 - margin));
        const cv::Point to(static_cast<int>(scale * ignored.x1 + margin),
                           static_cast<int>(scale * ignored.y1 + margin));
        cv::rectangle(level.seen, from, to, cv::Scalar(0), cv::FILLED);
    }
    return level;
}

struct Motion {
    double x = 0, y = 0, roll = 0;  // px of the level, px, radians about the image centre
    double gain = 1, offset = 0;    // photometric
};

constexpr int kStrips = 16;  // of the image's width

struct Difference {
    std::array<double, kStrips> cost{};  // sum of robust squared differences in each strip
    int used = 0;                        // pixels
};

// How much two images differ, and the step that lowers it.
Difference compare(const Level& first, const Level& now, const Motion& motion, Matrix5* square = nullptr,
                   Vector5* right = nullptr) {
    const cv::Mat& image = now.grey;
    const double cx = 0.5 * (image.cols - 1), cy = 0.5 * (image.rows - 1);
    const double cosine = std::cos(motion.roll), sine = std::sin(motion.roll);
    Difference difference;
    if (square) square->setZero(), right->setZero();
    for (int y = 2; y < image.rows - 2; ++y)
        for (int x = 2; x < image.cols - 2; ++x) {
            if (!first.seen.at<std::uint8_t>(y, x)) continue;
            const double u = cosine * (x - cx) - sine * (y - cy) + cx + motion.x;
            const double v = sine * (x - cx) + cosine * (y - cy) + cy + motion.y;
            const int i = static_cast<int>(std::floor(u)), j = static_cast<int>(std::floor(v));
            if (i < 1 || j < 1 || i + 2 >= image.cols || j + 2 >= image.rows ||
                !now.seen.at<std::uint8_t>(j, i))
                continue;
            const double a = u - i, b = v - j;
            const auto at = [&](int row, int column) {
                return static_cast<double>(image.at<float>(row, column));
            };
            const double upper = at(j, i) + a * (at(j, i + 1) - at(j, i));
            const double lower = at(j + 1, i) + a * (at(j + 1, i + 1) - at(j + 1, i));
            const double before = first.grey.at<float>(y, x);
            const double residual = upper + b * (lower - upper) - motion.gain * before - motion.offset;
            const double ratio =
                kNoise_grey * kNoise_grey / (kNoise_grey * kNoise_grey + residual * residual);
            difference.cost[static_cast<std::size_t>(x * kStrips / image.cols)] +=
                residual * residual * ratio;
            ++difference.used;
            if (!square) continue;
            const double by_u = (1 - b) * (at(j, i + 1) - at(j, i)) + b * (at(j + 1, i + 1) - at(j + 1, i));
            const double by_v = lower - upper;
            Vector5 slope;
            slope << by_u, by_v, by_u * -(v - cy - motion.y) + by_v * (u - cx - motion.x), -before, -1;
            *square += ratio * ratio * slope * slope.transpose();
            *right -= ratio * ratio * residual * slope;
        }
    return difference;
}

// The fraction of the difference that the rotation explains, 0..1. A rotation explains it all over the image,
// a subject in front of a plain wall in one part: two thirds of the visible strips have at least this
// fraction.
double explained_fraction(const Difference& still, const Difference& moved) {
    std::vector<double> explained;
    for (std::size_t strip = 0; strip < kStrips; ++strip)
        if (still.cost[strip] > 0)
            explained.push_back(std::clamp(1 - moved.cost[strip] / still.cost[strip], 0.0, 1.0));
    if (explained.empty()) return 0;
    std::ranges::sort(explained);
    return explained[explained.size() / 3];
}

Motion without_rotation(const Motion& light) {
    return {0, 0, 0, light.gain, light.offset};
}

constexpr double kMaxFraction =
    0.5;  // of the image: more is not the subject but the foreground of a moved camera

// The subjects in a camera's image, px: the projection of their volumes or, without one, the camera's
// foreground. A moved camera's foreground is the whole scene, which must not hide the movement.
kernels::Rect subject_box(const FrameResult& result, std::size_t c, const Camera& camera) {
    kernels::Rect box{camera.width, camera.height, 0, 0};
    bool projected = false;
    for (const SubjectResult& subject : result.subjects) {
        if (!subject.volume) continue;
        projected = true;
        const VolumeGrid& grid = subject.volume->grid;
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
    }
    if (!projected && c < result.silhouettes.size()) box = result.silhouettes[c].bounds;
    const double area = static_cast<double>(box.x1 - box.x0) * (box.y1 - box.y0);
    const bool usable =
        box.x0 < box.x1 && box.y0 < box.y1 && area < kMaxFraction * camera.width * camera.height;
    return usable ? box : kernels::Rect{};
}

}  // namespace

struct StaticScene::Levels {
    std::vector<Level> levels;
};

StaticScene::StaticScene(const Camera& camera) : camera_(camera) {}
StaticScene::~StaticScene() = default;
StaticScene::StaticScene(StaticScene&&) noexcept = default;
StaticScene& StaticScene::operator=(StaticScene&&) noexcept = default;

std::optional<SceneShift> StaticScene::measure(const Image& image, const kernels::Rect& ignored) {
    if (image.empty()) return std::nullopt;
    Levels now;
    const cv::Mat finest_image = reduced(image);
    for (const int width : kWidths_px) now.levels.push_back(level_of(finest_image, image, ignored, width));
    if (!first_) {
        first_ = std::make_unique<Levels>(std::move(now));
        return SceneShift{};
    }
    Motion motion;
    for (std::size_t l = 0; l < now.levels.size(); ++l) {
        if (l > 0)
            motion.x *= static_cast<double>(kWidths_px[l]) / kWidths_px[l - 1],
                motion.y *= static_cast<double>(kWidths_px[l]) / kWidths_px[l - 1];
        for (int round = 0; round < kRounds; ++round) {
            Matrix5 square;
            Vector5 right;
            const Difference difference = compare(first_->levels[l], now.levels[l], motion, &square, &right);
            if (difference.used < kMinVisibleFraction * static_cast<double>(now.levels[l].grey.total()))
                return std::nullopt;
            square.diagonal() *= 1 + 1e-4;
            const Vector5 step = square.ldlt().solve(right);
            if (!step.allFinite()) return std::nullopt;
            motion.x += step(0), motion.y += step(1), motion.roll += step(2), motion.gain += step(3),
                motion.offset += step(4);
            if (std::abs(step(0)) + std::abs(step(1)) < 0.005 && std::abs(step(2)) < 1e-5) break;
        }
    }
    const Level& finest = now.levels.back();
    const double px =
        static_cast<double>(std::max(camera_.width, camera_.height)) / kWidths_px[std::size(kWidths_px) - 1];
    const double lateral_px = px * std::hypot(motion.x, motion.y);
    SceneShift shift;
    shift.rotation_deg = degrees(std::hypot(std::atan(lateral_px / camera_.fx), motion.roll));
    shift.shift_px = std::hypot(lateral_px, 0.25 * std::max(camera_.width, camera_.height) * motion.roll);
    shift.explained = explained_fraction(compare(first_->levels.back(), finest, without_rotation(motion)),
                                         compare(first_->levels.back(), finest, motion));
    if (shift.rotation_deg < kStillRotation_deg)
        for (std::size_t l = 0; l < now.levels.size(); ++l) {
            Level& first = first_->levels[l];
            const cv::Mat fresh = now.levels[l].seen & (255 - first.seen);
            now.levels[l].grey.copyTo(first.grey, fresh);
            first.seen |= fresh;
        }
    return shift;
}

CameraMotionState::Change CameraMotionState::add(const std::optional<SceneShift>& shift,
                                                 const std::string& camera,
                                                 const CameraWatchOptions& options) {
    if (!shift) return Change::kNone;
    const bool differs = shift->rotation_deg >= options.suspect_deg;
    const bool moved = differs && shift->explained >= options.explained;
    if (moved || !differs) camera_.shift_px = shift->shift_px;
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
