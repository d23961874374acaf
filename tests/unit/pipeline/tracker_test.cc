#include "server/pipeline/tracking/tracker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/pipeline/scene.h"

namespace kinevox {
namespace {

using testing::body_at;
using testing::camera_at;
using testing::Ellipsoid;
using testing::four_cameras;
using testing::silhouettes_of;

constexpr double kFps = 30;

// Gives a tracker the silhouettes of a scene frame by frame.
class Stage {
  public:
    explicit Stage(std::vector<Camera> cameras) : cameras_(cameras), tracker_(std::move(cameras), kFps) {}

    // A camera whose entry in `instead` is not null sees that.
    TrackerUpdate show(const std::vector<Ellipsoid>& body,
                       std::vector<const std::vector<Ellipsoid>*> instead = {}, int silent = -1) {
        const auto time_ns = static_cast<std::int64_t>(std::llround(1e9 * frame_ / kFps));
        priors_ = tracker_.predict(time_ns);
        instead.resize(cameras_.size(), nullptr);
        std::vector<kernels::Silhouettes> made;
        for (std::size_t c = 0; c < cameras_.size(); ++c)
            made.push_back(silhouettes_of(cameras_[c], instead[c] ? *instead[c] : body));
        std::vector<const kernels::Silhouettes*> seen;
        for (std::size_t c = 0; c < cameras_.size(); ++c)
            seen.push_back(static_cast<int>(c) == silent ? nullptr : &made[c]);
        bounds_.clear();
        for (const auto& s : made) bounds_.push_back(s.bounds);
        return tracker_.update(static_cast<std::uint64_t>(frame_++), time_ns, seen);
    }

    const std::vector<Camera> cameras_;
    Tracker tracker_;
    std::vector<kernels::SegmentationPrior> priors_;
    std::vector<kernels::Rect> bounds_;
    int frame_ = 0;
};

const Event* event_of(const TrackerUpdate& update, EventKind kind) {
    for (const Event& event : update.events)
        if (event.kind == kind) return &event;
    return nullptr;
}

bool contains(const kernels::Rect& outer, const kernels::Rect& inner) {
    return outer.x0 <= inner.x0 && outer.y0 <= inner.y0 && outer.x1 >= inner.x1 && outer.y1 >= inner.y1;
}

bool covers(const kernels::Lattice& lattice, Vec3 low, Vec3 high) {
    const double a[3] = {low.x, low.y, low.z}, b[3] = {high.x, high.y, high.z};
    for (int n = 0; n < 3; ++n)
        if (lattice.origin[n] > a[n] || lattice.origin[n] + lattice.voxel_m * lattice.size[n] < b[n])
            return false;
    return true;
}

TEST(Tracker, FindsSubjectInFirstFrameSet) {
    Stage stage(four_cameras());
    const Vec3 at{0.4, -0.7, 0.88};
    const TrackerUpdate update = stage.show(body_at(at));
    ASSERT_TRUE(update.subject);
    EXPECT_TRUE(event_of(update, EventKind::kSubjectFound));
    EXPECT_LT(norm(update.subject->centre_in_world - at), 0.02);
    EXPECT_THAT(update.subject->used_cameras, ::testing::Each(true));
    ASSERT_TRUE(update.lattice);
    EXPECT_TRUE(covers(*update.lattice, at - Vec3{0.22, 0.16, 0.85}, at + Vec3{0.22, 0.16, 0.85}));
}

TEST(Tracker, FindsNoSubjectInEmptyScene) {
    Stage stage(four_cameras());
    for (int n = 0; n < 5; ++n) {
        const TrackerUpdate update = stage.show({});
        EXPECT_FALSE(update.subject);
        EXPECT_FALSE(update.lattice);
        EXPECT_TRUE(update.events.empty());
        for (const auto& prior : stage.priors_) EXPECT_TRUE(prior.region.empty());
    }
}

TEST(Tracker, ReportsExcludedAndIncludedCamera) {
    Stage stage(four_cameras());
    const Vec3 at{0.2, 0.1, 0.88};
    const auto elsewhere = body_at({1.0, 1.4, 0.88});
    for (int n = 0; n < 3; ++n) stage.show(body_at(at));
    bool reported = false;
    for (int n = 0; n < 8; ++n) {
        const TrackerUpdate update = stage.show(body_at(at), {nullptr, &elsewhere});
        ASSERT_TRUE(update.subject);
        EXPECT_LT(norm(update.subject->centre_in_world - at), 0.03);
        EXPECT_EQ(update.roles[1], CameraRole::kExcluded);
        EXPECT_THAT(update.subject->used_cameras, ::testing::ElementsAre(true, false, true, true));
        if (const Event* event = event_of(update, EventKind::kCameraExcluded)) {
            EXPECT_EQ(event->camera, "east");
            reported = true;
        }
    }
    EXPECT_TRUE(reported);
    bool included = false;
    for (int n = 0; n < 8; ++n) {
        const TrackerUpdate update = stage.show(body_at(at));
        EXPECT_FALSE(event_of(update, EventKind::kCameraResumed)) << "it never stopped delivering images";
        if (const Event* event = event_of(update, EventKind::kCameraIncluded))
            included = event->camera == "east";
    }
    EXPECT_TRUE(included);
}

TEST(Tracker, ContinuesWithoutOneCamera) {
    Stage stage(four_cameras());
    const Vec3 at{0.2, 0.1, 0.88};
    stage.show(body_at(at));
    const TrackerUpdate update = stage.show(body_at(at), {}, 2);
    ASSERT_TRUE(update.subject);
    EXPECT_LT(norm(update.subject->centre_in_world - at), 0.03);
    EXPECT_EQ(update.roles[2], CameraRole::kNoImage);
    ASSERT_TRUE(event_of(update, EventKind::kCameraNoImage));
    EXPECT_EQ(event_of(update, EventKind::kCameraNoImage)->camera, "south");
    const TrackerUpdate next = stage.show(body_at(at));
    ASSERT_TRUE(event_of(next, EventKind::kCameraResumed));
    EXPECT_FALSE(event_of(next, EventKind::kCameraIncluded)) << "it was never excluded";
}

TEST(Tracker, DoesNotExcludeCameraWithoutView) {
    std::vector<Camera> cameras = four_cameras();
    cameras.push_back(camera_at("door", {0, -3, 1.5}, {0, -8, 1}));  // looks the other way
    Stage stage(cameras);
    for (int n = 0; n < 10; ++n) {
        const TrackerUpdate update = stage.show(body_at({0.2, 0.1, 0.88}));
        ASSERT_TRUE(update.subject);
        EXPECT_EQ(update.roles[4], CameraRole::kOutOfView);
        EXPECT_FALSE(update.subject->used_cameras[4]);
        EXPECT_FALSE(event_of(update, EventKind::kCameraExcluded));
    }
}

TEST(Tracker, LosesAndFindsSubjectOnce) {
    Stage stage(four_cameras());
    for (int n = 0; n < 5; ++n) stage.show(body_at({0.2, 0.1, 0.88}));
    int lost = 0;
    for (int n = 0; n < 30; ++n) {
        const TrackerUpdate update = stage.show({});
        EXPECT_FALSE(update.lattice);
        if (n < 10) {
            EXPECT_TRUE(update.subject) << "a short gap is bridged";
        }
        lost += event_of(update, EventKind::kSubjectLost) != nullptr;
    }
    EXPECT_EQ(lost, 1);
    EXPECT_FALSE(stage.tracker_.tracking());
    const TrackerUpdate update = stage.show(body_at({-0.8, 0.9, 0.88}));
    ASSERT_TRUE(update.subject);
    EXPECT_TRUE(event_of(update, EventKind::kSubjectFound));
    EXPECT_EQ(update.subject->subject_id, 2u);
}

TEST(Tracker, IgnoresOtherPersonInOneImage) {
    Stage stage(four_cameras());
    for (int n = 0; n < 20; ++n) {
        const Vec3 at{-1 + 0.04 * n, 0, 0.88};
        auto with_bystander = body_at(at);
        for (const Ellipsoid& e : body_at({1.2, 1.0, 0.9})) with_bystander.push_back(e);
        const TrackerUpdate update = stage.show(body_at(at), {nullptr, nullptr, &with_bystander});
        ASSERT_TRUE(update.subject) << n;
        EXPECT_LT(norm(update.subject->centre_in_world - at), 0.06) << n;
    }
}

// 12 m behind a push-off: eight cameras along the lane, each of which sees a part of it, and one at each end.
TEST(Tracker, FollowsSprinterAlongLane) {
    std::vector<Camera> cameras;
    for (int n = 0; n < 4; ++n) {
        const double x = 1.5 + 3.0 * n;
        cameras.push_back(camera_at("left" + std::to_string(n), {x, 4, 2}, {x, 0, 0.9}));
        cameras.push_back(camera_at("right" + std::to_string(n), {x, -4, 1.5}, {x, 0, 0.9}));
    }
    cameras.push_back(camera_at("start", {-4, 1, 2}, {6, 0, 0.9}));
    cameras.push_back(camera_at("finish", {16, -1, 2}, {6, 0, 0.9}));
    Stage stage(cameras);
    Vec3 at{0, 0, 0.88};
    double speed = 0;
    for (int n = 0; at.x < 12; ++n) {
        const TrackerUpdate update = stage.show(body_at(at));
        ASSERT_TRUE(update.subject) << "at x = " << at.x;
        EXPECT_LT(norm(update.subject->centre_in_world - at), 0.06) << "at x = " << at.x;
        ASSERT_TRUE(update.lattice);
        EXPECT_TRUE(covers(*update.lattice, at - Vec3{0.22, 0.16, 0.85}, at + Vec3{0.22, 0.16, 0.85}));
        EXPECT_LT(update.lattice->size[0], 160);
        EXPECT_LT(update.lattice->size[1], 160);
        EXPECT_LT(update.lattice->size[2], 240);
        EXPECT_FALSE(event_of(update, EventKind::kSubjectLost));
        EXPECT_FALSE(event_of(update, EventKind::kCameraExcluded));
        if (n > 0)
            for (std::size_t c = 0; c < cameras.size(); ++c) {
                EXPECT_TRUE(stage.bounds_[c].empty() || contains(stage.priors_[c].region, stage.bounds_[c]))
                    << cameras[c].name << " at x = " << at.x;
            }
        speed = std::min(9.0, speed + 7.0 / kFps);
        at.x += speed / kFps;
    }
}

TEST(Tracker, LearnsShapeOffsetFromVolume) {
    Stage stage(four_cameras());
    const Vec3 at{0.2, 0.1, 0.88}, centre = at + Vec3{0.03, 0, 0.05};
    for (int n = 0; n < 30; ++n) {
        stage.show(body_at(at));
        stage.tracker_.observe_volume(centre, false);
    }
    const TrackerUpdate update = stage.show(body_at(at));
    ASSERT_TRUE(update.subject);
    EXPECT_LT(norm(update.subject->centre_in_world - centre), 0.01);
    // A volume gone wrong does not carry G away.
    for (int n = 0; n < 30; ++n) {
        stage.show(body_at(at));
        stage.tracker_.observe_volume(at + Vec3{0, 2, 0}, false);
    }
    EXPECT_LT(norm(stage.show(body_at(at)).subject->centre_in_world - at), 0.2);
}

// Trousers of the floor's colour: what is left of the subject ends at the hips.
TEST(Tracker, SearchesForLegsDownToFloor) {
    Stage stage(four_cameras());
    const auto whole = body_at({0.2, 0.1, 0.88});
    const std::vector<Ellipsoid> legless(whole.begin(), whole.begin() + 2);
    for (int n = 0; n < 6; ++n) {
        stage.show(n == 0 ? whole : legless);
        stage.tracker_.observe_volume({0.2, 0.1, 1.1}, n > 0);
    }
    stage.show(whole);
    for (std::size_t c = 0; c < 4; ++c) {
        EXPECT_TRUE(contains(stage.priors_[c].region, stage.bounds_[c])) << stage.cameras_[c].name;
        EXPECT_LT(stage.priors_[c].max_distance_px, 0) << "feet may be far from what is left";
    }
    stage.tracker_.observe_volume({0.2, 0.1, 0.88}, false);
    stage.show(whole);
    EXPECT_GT(stage.priors_[0].max_distance_px, 0);
}

TEST(Tracker, SearchesWholeImagesPeriodically) {
    Stage stage(four_cameras());
    std::vector<int> full(4, 0);
    for (int n = 0; n < 31; ++n) {
        stage.show(body_at({0.2, 0.1, 0.88}));
        int now = 0;
        for (std::size_t c = 0; c < 4; ++c)
            if (stage.priors_[c].full_pass) ++full[c], ++now;
        EXPECT_LE(now, n > 0 ? 1 : 4) << "no frame set pays for all cameras";
    }
    EXPECT_THAT(full, ::testing::Each(::testing::AllOf(::testing::Ge(2), ::testing::Le(4))));
}

}  // namespace
}  // namespace kinevox
