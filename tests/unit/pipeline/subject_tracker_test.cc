// One subject to follow, alone and beside others.
#include "server/pipeline/tracking/subject_tracker.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "server/pipeline/subject_control.h"
#include "server/pipeline/tracking/elsewhere.h"
#include "server/pipeline/tracking/occupied_cells.h"
#include "tests/unit/pipeline/scene.h"

namespace kinevox {
namespace {

using testing::blue_at;
using testing::camera_at;
using ::testing::ContainsRegex;
using testing::Dressed;
using testing::DressedImages;
using ::testing::ElementsAre;
using testing::Ellipsoid;
using testing::four_cameras;
using testing::green_at;
using ::testing::IsEmpty;
using testing::people_at;
using testing::points_of;
using testing::silhouettes_of;
using ::testing::SizeIs;

constexpr double kSceneFps = 25;
constexpr double kBeside_m = 0.8;  // within a lone subject's volume

// With voxels of 4 cm.
kernels::VoxelVolume shape_of(const std::vector<Ellipsoid>& body) {
    const Vec3 centre = body.front().centre;
    const double half_m = body.size() > people_at({Vec3{}}).size() ? 1.1 : 0.4;
    const Vec3 half{half_m, half_m, 0.9};
    const OccupiedCells grid(lattice_over({centre - half, centre + half}, 0.04, 3, centre));
    const auto is_inside = [](Vec3 p, const Ellipsoid& e) {
        const Vec3 d = p - e.centre;
        return norm({d.x / e.radii.x, d.y / e.radii.y, d.z / e.radii.z}) <= 1;
    };
    Cells cells;
    const auto& size = grid.lattice().size;
    for (std::int32_t cell = 0; cell < size[0] * size[1] * size[2]; ++cell)
        if (std::ranges::any_of(body,
                                [&](const Ellipsoid& e) { return is_inside(grid.centre_in_world(cell), e); }))
            cells.push_back(cell);
    return grid.volume_of(cells);
}

// Shows the tracker a scene frame by frame, and gives it the volume of the person nearest to its subject,
// while people are not separated with those beside.
class Room {
  public:
    // `seeing`: the cameras that make the silhouettes, if other ones than calibrated.
    explicit Room(std::vector<Camera> seeing = four_cameras(), int max_subjects = 1)
        : seeing_(std::move(seeing)),
          control_(max_subjects),
          tracker_(four_cameras(), kSceneFps, {.max_subjects = max_subjects}, control_) {}

    SceneUpdate show_dressed(const std::vector<Dressed>& people) {
        return show(points_of(people), DressedImages(seeing_, people).views());
    }
    SceneUpdate show(const std::vector<Vec3>& floor_points, std::span<const kernels::ImageView> images = {}) {
        const auto time_ns = static_cast<std::int64_t>(std::llround(1e9 * frame_ / kSceneFps));
        tracker_.predict(time_ns);
        std::vector<kernels::Silhouettes> made;
        for (const Camera& camera : seeing_) made.push_back(silhouettes_of(camera, people_at(floor_points)));
        std::vector<const kernels::Silhouettes*> seen;
        for (const auto& s : made) seen.push_back(&s);
        SceneUpdate update = tracker_.update(static_cast<std::uint64_t>(frame_++), time_ns, seen, images);
        for (const Event& event : update.events)
            if (event.subject_id != 0) events_.push_back(event.message);
        for (const SceneSubject& subject : update.subjects) {
            if (!subject.lattice) continue;
            const Vec3 centre = subject.track.centre_in_world;
            const Vec3 nearest = *std::ranges::min_element(
                floor_points, {}, [&](Vec3 at) { return std::hypot(at.x - centre.x, at.y - centre.y); });
            std::vector<Vec3> within{nearest};
            for (const Vec3 at : floor_points)
                if (!tracker_.separates() && norm(at - nearest) > 0 && norm(at - nearest) < kBeside_m)
                    within.push_back(at);
            tracker_.observe_volume(centre, false, shape_of(people_at(within)));
        }
        return update;
    }
    const SubjectTracker& tracker() const { return tracker_; }
    SubjectControl& control() { return control_; }
    const std::vector<std::string>& events() const { return events_; }  // of subjects

  private:
    std::vector<Camera> seeing_;
    SubjectControl control_;
    SubjectTracker tracker_;
    std::vector<std::string> events_;
    int frame_ = 0;
};

// Of the centre of a hull that includes some of a person beside.
constexpr double kMaxOffset_m = 0.18;

void expect_at(const SceneUpdate& update, Vec3 floor_point, int frame) {
    ASSERT_THAT(update.subjects, SizeIs(1)) << frame;
    const SubjectTrack& track = update.subjects[0].track;
    EXPECT_EQ(track.subject_id, 1u) << frame;
    EXPECT_LT(std::hypot(track.centre_in_world.x - floor_point.x, track.centre_in_world.y - floor_point.y),
              kMaxOffset_m)
        << frame;
}

constexpr Vec3 kAthlete{0.4, 0.2, 0};

TEST(SubjectTracker, TracksLonePersonAsSuch) {
    Room room;
    for (int n = 0; n < 40; ++n) {
        expect_at(room.show({kAthlete}), kAthlete, n);
        EXPECT_FALSE(room.tracker().separates()) << n;
    }
    EXPECT_THAT(room.control().list(), SizeIs(1));
}

// Who passes at half a metre is a bystander, and the subject keeps id and position.
TEST(SubjectTracker, KeepsSubjectWhileAnotherPersonPasses) {
    Room room;
    for (int n = 0; n < 20; ++n) room.show({kAthlete});
    bool separated = false;
    std::size_t bystanders = 0;
    for (int n = 0; n < 75; ++n) {
        const SceneUpdate update = room.show({kAthlete, {kAthlete.x + 0.55, 2 - 4.0 * n / 75, 0}});
        expect_at(update, kAthlete, n);
        separated |= room.tracker().separates();
        bystanders = std::max(bystanders, update.bystanders.size());
    }
    EXPECT_TRUE(separated);
    EXPECT_EQ(bystanders, 1u);
    EXPECT_THAT(room.control().list(), SizeIs(2));
    for (int n = 0; n < 60; ++n) expect_at(room.show({kAthlete}), kAthlete, n);
    EXPECT_FALSE(room.tracker().separates()) << "alone again";
    EXPECT_THAT(room.events(), SizeIs(1)) << "found once";
}

TEST(SubjectTracker, FollowsOneOfTwoFromTheStart) {
    Room room;
    SceneUpdate update;
    for (int n = 0; n < 10; ++n) {
        update = room.show({kAthlete, {-0.5, -0.4, 0}});
        ASSERT_THAT(update.subjects, SizeIs(1)) << n;
    }
    EXPECT_TRUE(room.tracker().separates());
    EXPECT_THAT(update.bystanders, SizeIs(1));
}

TEST(SubjectTracker, ObeysRequestsAboutLonePerson) {
    Room room;
    for (int n = 0; n < 10; ++n) room.show({kAthlete});
    ASSERT_TRUE(room.control().set_name(1, "Anna").ok());
    EXPECT_EQ(room.show({kAthlete}).subjects[0].track.name, "Anna");
    ASSERT_TRUE(room.control().ignore({1}).ok());
    for (int n = 0; n < 40; ++n) EXPECT_THAT(room.show({kAthlete}).subjects, IsEmpty()) << n;
    room.control().follow_all();
    SceneUpdate update;
    for (int n = 0; n < 60; ++n) update = room.show({kAthlete});
    expect_at(update, kAthlete, 60);
    EXPECT_EQ(update.subjects[0].track.name, "Anna");
    EXPECT_FALSE(room.tracker().separates());
}

// Its silhouettes would carve the subject away.
TEST(SubjectTracker, LeavesOutlierCameraOutBesideOthers) {
    std::vector<Camera> seeing = four_cameras();
    seeing[3] = camera_at("west", {-4, 4, 1.6}, {1.2, -0.8, 1});
    Room room(seeing);
    SceneUpdate update;
    for (int n = 0; n < 60; ++n) update = room.show({kAthlete});
    ASSERT_EQ(update.subjects[0].roles[3], CameraRole::kExcluded);
    ASSERT_FALSE(room.tracker().separates());
    for (int n = 0; n < 50; ++n) {
        update = room.show({kAthlete, {-0.6, 0.9, 0}});
        expect_at(update, kAthlete, n);
    }
    EXPECT_TRUE(room.tracker().separates());
    EXPECT_TRUE(update.subjects[0].lattice.has_value());
    EXPECT_EQ(update.subjects[0].roles[3], CameraRole::kExcluded);
}

// With several to follow, too, a lone person costs no more; who enters is followed soon.
TEST(SubjectTracker, SeparatesOnlyWhileSeveralAreThere) {
    constexpr int kSoon = 7;  // frame sets, 0.28 s
    const Dressed athlete = green_at(kAthlete), partner = blue_at({-0.6, 0.9, 0});
    Room room(four_cameras(), 2);
    SceneUpdate update;
    for (int n = 0; n < 30; ++n) {
        expect_at(room.show_dressed({athlete}), kAthlete, n);
        EXPECT_FALSE(room.tracker().separates()) << n;
    }
    for (int n = 0; n < 60; ++n) {
        update = room.show_dressed({athlete, partner});
        if (n < kSoon) continue;
        ASSERT_THAT(update.subjects, SizeIs(2)) << n;
        EXPECT_EQ(update.subjects[1].track.subject_id, 2u);
    }
    for (int n = 0; n < 60; ++n) update = room.show_dressed({athlete});
    expect_at(update, kAthlete, 150);
    EXPECT_FALSE(room.tracker().separates());
    for (int n = 0; n < 20; ++n) update = room.show_dressed({athlete, partner});
    ASSERT_THAT(update.subjects, SizeIs(2));
    EXPECT_EQ(update.subjects[1].track.subject_id, 2u) << "recognised";
}

// Another person's silhouettes merge with the subject's before anything shows outside of its box.
TEST(SubjectTracker, SeparatesPersonInItsVolume) {
    Room room(four_cameras(), 2);
    for (int n = 0; n < 20; ++n) room.show({kAthlete});
    const Vec3 partner{kAthlete.x - 0.4, kAthlete.y + 0.4, 0};
    for (int n = 0; n < 30; ++n) {
        const SceneUpdate update = room.show({kAthlete, partner});
        if (n < 7) continue;
        ASSERT_THAT(update.subjects, SizeIs(2)) << n;
        EXPECT_LT(norm(update.subjects[0].track.centre_in_world - kAthlete - Vec3{0, 0, 0.9}), 0.25) << n;
    }
    EXPECT_THAT(room.events(), SizeIs(2));
}

TEST(SceneTracker, KnowsVolumeOfSeveral) {
    SceneTracker scene(four_cameras(), kSceneFps, {});
    const Vec3 partner{kAthlete.x - 0.4, kAthlete.y + 0.5, 0};
    const kernels::VoxelVolume one = shape_of(people_at({kAthlete})),
                               two = shape_of(people_at({kAthlete, partner}));
    EXPECT_FALSE(scene.holds_several(one, {}));
    EXPECT_FALSE(scene.holds_several(one, one));
    EXPECT_TRUE(scene.holds_several(two, {})) << "two trunks";
    EXPECT_TRUE(scene.holds_several(two, one));
    EXPECT_FALSE(scene.holds_several({}, one));
}

TEST(SubjectTracker, GivesOldIdToLonePersonWhoReturns) {
    Room room;
    SceneUpdate update;
    for (int n = 0; n < 30; ++n) update = room.show_dressed({green_at(kAthlete)});
    expect_at(update, kAthlete, 30);
    for (int n = 0; n < 30; ++n) room.show_dressed({});
    const Vec3 stranger{-0.5, -0.4, 0}, returns{-0.6, 0.8, 0};
    for (int n = 0; n < 30; ++n) update = room.show_dressed({blue_at(stranger)});
    ASSERT_THAT(update.subjects, SizeIs(1));
    EXPECT_EQ(update.subjects[0].track.subject_id, 2u);
    for (int n = 0; n < 30; ++n) room.show_dressed({});
    for (int n = 0; n < 30; ++n) update = room.show_dressed({green_at(returns)});
    expect_at(update, returns, 150);
    EXPECT_FALSE(room.tracker().separates());
    EXPECT_THAT(room.control().list(), SizeIs(2)) << "the stranger would be recognised, too";
    EXPECT_THAT(room.events(),
                ElementsAre(ContainsRegex("subject 1 found at"), ContainsRegex("subject 1 lost"),
                            ContainsRegex("subject 2 found at"), ContainsRegex("subject 2 lost"),
                            ContainsRegex("subject 1 recognised \\(9[0-9] % sure\\) at")));
}

kernels::Silhouettes empty_silhouettes() {
    kernels::Silhouettes s;
    s.width = 320, s.height = 240;
    s.probability.assign(std::size_t{320} * 240, 0);
    return s;
}

void fill_probability(const kernels::Rect& box, kernels::Silhouettes& s) {
    for (int y = box.y0; y < box.y1; ++y)
        for (int x = box.x0; x < box.x1; ++x) s.probability[static_cast<std::size_t>(y) * s.width + x] = 200;
}

TEST(PersonOutside, IsAsLargeAsAPerson) {
    const Camera camera = four_cameras()[0];
    kernels::Silhouettes s = empty_silhouettes();
    const auto fill = [&](const kernels::Rect& box) { fill_probability(box, s); };
    const kernels::Rect subject{100, 40, 160, 220};
    fill({110, 50, 150, 210});
    EXPECT_FALSE(shows_person_outside(camera, s, subject));
    fill({300, 100, 316, 110});
    EXPECT_FALSE(shows_person_outside(camera, s, subject)) << "too low";
    fill({240, 80, 264, 150});
    EXPECT_TRUE(shows_person_outside(camera, s, subject));
}

TEST(PersonOutside, LiesAlongTheRowsOfACameraInPortraitFormat) {
    Camera camera = four_cameras()[0];
    kernels::Silhouettes s = empty_silhouettes();
    fill_probability({230, 80, 300, 96}, s);
    EXPECT_FALSE(shows_person_outside(camera, s, {}));
    camera.camera_from_world.rotation = rotation_z(radians(90)) * camera.camera_from_world.rotation;
    EXPECT_TRUE(shows_person_outside(camera, s, {}));
}

}  // namespace
}  // namespace kinevox
