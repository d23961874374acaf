#include "tests/support/fake_capture.h"

#include <chrono>
#include <limits>

namespace kinevox::testing {
namespace {

constexpr int kWidth = 64, kHeight = 48;

Image image(std::uint8_t grey) {
    std::shared_ptr<std::uint8_t[]> data(new std::uint8_t[kWidth * kHeight * 3]);
    std::fill_n(data.get(), kWidth * kHeight * 3, grey);
    return {kWidth, kHeight, 3, data};
}

}  // namespace

std::vector<Camera> fake_cameras() {
    Camera left;
    left.name = "left";
    left.width = kWidth;
    left.height = kHeight;
    left.fx = left.fy = 60;
    left.cx = 31.5;
    left.cy = 23.5;
    left.camera_from_world.rotation.m = {1, 0, 0, 0, 0, -1, 0, 1, 0};  // looks along +y, z up
    left.camera_from_world.translation = {0, 1, 4};
    Camera right = left;
    right.name = "right";
    right.camera_from_world.translation = {-0.5, 1, 4};
    return {left, right};
}

class FakeSource : public FrameSource {
  public:
    explicit FakeSource(FakeSourceControl& control) : control_(control), cameras_(fake_cameras()) {}

    const std::vector<Camera>& cameras() const override { return cameras_; }
    double fps() const override { return 100; }
    std::int64_t frame_count() const override { return -1; }
    std::vector<CameraConnection> camera_connections() const override {
        return std::vector<CameraConnection>(control_.cameras ? cameras_.size() : 0);
    }
    absl::StatusOr<std::vector<std::vector<Image>>> background() override {
        if (!control_.with_background) return std::vector<std::vector<Image>>();
        return std::vector<std::vector<Image>>(2, {image(10), image(11)});
    }
    absl::StatusOr<FrameSet> next() override {
        std::unique_lock lock(control_.mutex_);
        control_.changed_.wait(lock, [&] { return stopped_ || control_.waiting_ > 0 || control_.last_; });
        if (stopped_) return absl::CancelledError("stopped");
        if (control_.waiting_ == 0) return *control_.last_;
        --control_.waiting_;
        sequence_ += static_cast<std::uint64_t>(std::exchange(control_.lost_, 0));
        FrameSet set;
        set.sequence = sequence_++;
        set.capture_time_ns = static_cast<std::int64_t>(set.sequence) * 10'000'000;
        if (control_.live)
            set.capture_time_ns =
                std::chrono::steady_clock::now().time_since_epoch() / std::chrono::nanoseconds(1);
        set.images = {image(static_cast<std::uint8_t>(100 + set.sequence % 100)), image(50)};
        return set;
    }
    void stop() override {
        const std::scoped_lock lock(control_.mutex_);
        stopped_ = true;
        control_.changed_.notify_all();
    }

  private:
    FakeSourceControl& control_;
    const std::vector<Camera> cameras_;
    std::uint64_t sequence_ = 0;
    bool stopped_ = false;  // under the control's mutex
};

void FakeSourceControl::give(int frame_sets) {
    const std::scoped_lock lock(mutex_);
    waiting_ += frame_sets;
    changed_.notify_all();
}

void FakeSourceControl::end() {
    fail(absl::OutOfRangeError("the recording is over"));
}

void FakeSourceControl::fail(absl::Status status) {
    const std::scoped_lock lock(mutex_);
    last_ = std::move(status);
    changed_.notify_all();
}

void FakeSourceControl::lose(int frame_sets) {
    const std::scoped_lock lock(mutex_);
    lost_ += frame_sets;
}

std::unique_ptr<FrameSource> FakeSourceControl::open() {
    const std::scoped_lock lock(mutex_);
    ++opened_;
    return std::make_unique<FakeSource>(*this);
}

int FakeSourceControl::waiting() const {
    const std::scoped_lock lock(mutex_);
    return waiting_;
}

int FakeSourceControl::opened() const {
    const std::scoped_lock lock(mutex_);
    return opened_;
}

absl::Status FakePipeline::learn_background(const std::vector<std::vector<Image>>& empty_scene) {
    learned_images = empty_scene.front().size();
    return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<Reconstruction>> FakePipeline::reconstruct(FrameSet frame_set) {
    if (on_reconstruct) on_reconstruct(frame_set.sequence);
    if (reconstruct_error) return *reconstruct_error;
    auto result = std::make_shared<FrameResult>(*fake_result(frame_set.sequence, volume_));
    result->capture_time_ns = frame_set.capture_time_ns;
    result->frame_set = std::move(frame_set);
    kernels::Silhouettes silhouettes;
    silhouettes.width = kWidth;
    silhouettes.height = kHeight;
    silhouettes.sharp.assign(kWidth * kHeight, 0);
    silhouettes.loose.assign(kWidth * kHeight, 0);
    for (int y = 10; y < 40; ++y)
        for (int x = 20; x < 44; ++x) {
            silhouettes.loose[static_cast<std::size_t>(y * kWidth + x)] = 255;
            if (x >= 24 && x < 40) silhouettes.sharp[static_cast<std::size_t>(y * kWidth + x)] = 255;
        }
    result->silhouettes.assign(2, silhouettes);
    for (SubjectResult& subject : result->subjects) subject.silhouette_iou = {0.9f, 0.8f};
    auto reconstruction = std::make_unique<Reconstruction>();
    reconstruction->result = std::move(result);
    return reconstruction;
}

absl::StatusOr<FrameResultPtr> FakePipeline::pose(std::unique_ptr<Reconstruction> reconstruction) {
    if (on_pose) on_pose(reconstruction->result->sequence);
    if (pose_error) return *pose_error;
    return reconstruction->result;
}

std::shared_ptr<const BodyPose> fake_pose(std::uint64_t sequence) {
    auto pose = std::make_shared<BodyPose>();
    pose->subject_id = 1;
    pose->sequence = sequence;
    for (std::size_t i = 0; i < pose->joints.size(); ++i)
        pose->joints[i] = {{0.1 * static_cast<double>(i), 0, 1}, 0.01, 2, {}};
    for (AngleEstimate& angle : pose->angles) angle = {0.5, 0.02, 1, 2, {}};
    const double none = std::numeric_limits<double>::quiet_NaN();
    pose->joints.back() = {{none, none, none}, none, 0, "outside every image"};
    pose->angles.front() = {none, none, none, 0, "the ankle is hidden"};
    pose->angles[1].velocity_rad_per_s = none;
    pose->ratios.knee_hip_flexion_ratio_l = 2;
    pose->ratios.knee_hip_flexion_ratio_r = none;
    return pose;
}

FrameResultPtr fake_result(std::uint64_t sequence, std::shared_ptr<const Volume> volume) {
    auto result = std::make_shared<FrameResult>();
    result->sequence = sequence;
    result->capture_time_ns = static_cast<std::int64_t>(sequence) * 10'000'000;
    result->times.hull_ms = 2;
    result->times.total_ms = 5;
    if (volume) {
        SubjectResult& subject = result->subjects.emplace_back();
        subject.track.subject_id = 1;
        subject.track.centre_in_world = {0.1, 0.2, 0.9};
        subject.track.used_cameras = {true, false};
        subject.volume = std::move(volume);
        subject.pose = fake_pose(sequence);
    }
    return result;
}

}  // namespace kinevox::testing
