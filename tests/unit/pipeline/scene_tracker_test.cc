// Several subjects in the hull of the whole scene.
#include "server/pipeline/tracking/scene_tracker.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "server/pipeline/subject_control.h"
#include "server/pipeline/subject_views.h"
#include "server/silhouettes/to_kernel.h"
#include "tests/unit/pipeline/scene.h"

namespace kinevox {
namespace {

using testing::blue_at;
using testing::body_at;
using testing::camera_at;
using testing::Dressed;
using testing::DressedImages;
using ::testing::Each;
using ::testing::ElementsAre;
using testing::Ellipsoid;
using testing::four_cameras;
using testing::green_at;
using ::testing::IsEmpty;
using testing::kStandingCentre_m;
using testing::people_at;
using testing::points_of;
using testing::red_at;
using testing::silhouettes_of;
using ::testing::SizeIs;

constexpr double kPeopleFps = 30;

TrackerOptions for_people(int max_subjects) {
    TrackerOptions options;
    options.max_subjects = max_subjects;
    return options;
}

// Gives a tracker the silhouettes of a scene frame by frame.
class People {
  public:
    explicit People(int max_subjects, std::vector<Camera> cameras = four_cameras(), double fps = kPeopleFps)
        : People(for_people(max_subjects), std::move(cameras), fps) {}
    explicit People(const TrackerOptions& options, std::vector<Camera> cameras = four_cameras(),
                    double fps = kPeopleFps)
        : cameras_(cameras),
          fps_(fps),
          control_(options.max_subjects),
          tracker_(std::move(cameras), fps, options, &control_) {}

    SceneUpdate show(const std::vector<Vec3>& floor_points, std::span<const kernels::ImageView> images = {}) {
        return show_bodies(people_at(floor_points), images);
    }
    SceneUpdate show_bodies(const std::vector<Ellipsoid>& bodies,
                            std::span<const kernels::ImageView> images = {}) {
        const auto time_ns = static_cast<std::int64_t>(std::llround(1e9 * frame_ / fps_));
        tracker_.predict(time_ns);
        std::vector<kernels::Silhouettes> made;
        for (const Camera& camera : cameras_) made.push_back(silhouettes_of(camera, bodies));
        std::vector<const kernels::Silhouettes*> seen;
        for (const auto& s : made) seen.push_back(&s);
        return tracker_.update(static_cast<std::uint64_t>(frame_++), time_ns, seen, images);
    }
    // The same with images of them in these clothes.
    SceneUpdate show_dressed(const std::vector<Dressed>& people) {
        return show(points_of(people), DressedImages(cameras_, people).views());
    }
    SubjectControl& control() { return control_; }
    // The id of the subject nearest to a point, at most 0.2 m away; 0: none.
    static std::uint32_t id_at(const SceneUpdate& update, Vec3 floor_point) {
        std::uint32_t id = 0;
        double nearest_m = 0.2;
        for (const SceneSubject& subject : update.subjects) {
            const Vec3 offset = subject.track.centre_in_world - floor_point;
            if (const double d = std::hypot(offset.x, offset.y); d < nearest_m)
                nearest_m = d, id = subject.track.subject_id;
        }
        return id;
    }
    const SceneTracker& tracker() const { return tracker_; }

  private:
    std::vector<Camera> cameras_;
    double fps_;
    SubjectControl control_;
    SceneTracker tracker_;
    int frame_ = 0;
};

TEST(SceneTracker, FindsPeopleAtTheirPlaces) {
    People people(4);
    SceneUpdate update;
    for (int n = 0; n < 4; ++n) update = people.show({{0.9, 0.3, 0}, {-0.7, -0.8, 0}, {-0.6, 1.1, 0}});
    ASSERT_THAT(update.subjects, SizeIs(3));
    for (const Vec3& at : {Vec3{0.9, 0.3, 0}, Vec3{-0.7, -0.8, 0}, Vec3{-0.6, 1.1, 0}})
        EXPECT_NE(People::id_at(update, at), 0u);
    for (const SceneSubject& subject : update.subjects) {
        EXPECT_TRUE(subject.lattice.has_value());
        EXPECT_NEAR(subject.track.centre_in_world.z, kStandingCentre_m, 0.06);
        EXPECT_THAT(subject.track.used_cameras, Each(true));
    }
}

// A box around both is mostly outside the images of cameras of a portrait format.
TEST(SceneTracker, UsesAllCamerasForPersonWithLongShadow) {
    std::vector<Camera> cameras;
    for (const Vec3& eye : {Vec3{3, 3, 2}, Vec3{3, -3, 1.8}, Vec3{-3, -3, 2.2}, Vec3{-3, 3, 1.6}})
        cameras.push_back(
            camera_at(fmt::format("camera_{}", cameras.size()), eye, {0, 0, 0.8}, 120, 320, 400));
    People people(1, cameras);
    std::vector<Ellipsoid> bodies = body_at({0, 0, kStandingCentre_m});
    bodies.push_back({{0, 0, 0.03}, {1.9, 0.15, 0.04}});
    bodies.push_back({{0, 0, 0.03}, {0.15, 1.9, 0.04}});
    SceneUpdate update;
    for (int n = 0; n < 4; ++n) update = people.show_bodies(bodies);
    ASSERT_THAT(update.subjects, SizeIs(1));
    EXPECT_THAT(update.subjects[0].track.used_cameras, Each(true));
}

TEST(SceneTracker, StartsNoMoreThanMaxSubjects) {
    People people(2);
    SceneUpdate update;
    for (int n = 0; n < 6; ++n) update = people.show({{0.9, 0.3, 0}, {-0.7, -0.8, 0}, {-0.6, 1.1, 0}});
    EXPECT_THAT(update.subjects, SizeIs(2));
}

// Their hulls are one part for half a second.
TEST(SceneTracker, KeepsIdsWhilePeopleTouch) {
    People people(4);
    std::set<std::uint32_t> left, right;
    for (int n = 0; n <= 60; ++n) {
        const double half_m = 0.17 + 0.8 * std::abs(n - 30) / 30.0;
        const Vec3 a{-half_m, 0.1, 0}, b{half_m, -0.1, 0};
        const SceneUpdate update = people.show({a, b});
        if (n < 4) continue;
        ASSERT_THAT(update.subjects, SizeIs(2)) << n;
        left.insert(People::id_at(update, a));
        right.insert(People::id_at(update, b));
    }
    EXPECT_THAT(left, SizeIs(1));
    EXPECT_THAT(right, SizeIs(1));
    EXPECT_NE(*left.begin(), 0u);
    EXPECT_NE(*left.begin(), *right.begin());
}

// In two cameras at right angles, two people have four intersections of cones.
TEST(SceneTracker, StartsNoSubjectInGhosts) {
    People people(4, {camera_at("x", {5, 0, 1.5}, {0, 0, 1}), camera_at("y", {0, 5, 1.5}, {0, 0, 1}),
                      camera_at("z", {-3.6, -3.6, 2.2}, {0, 0, 1})});
    SceneUpdate update;
    for (int n = 0; n < 8; ++n) update = people.show({{0.7, 0.7, 0}, {-0.7, -0.4, 0}});
    EXPECT_THAT(update.subjects, SizeIs(2));
}

TEST(SceneTracker, ReportsWhoEntersAndLeaves) {
    People people(4);
    for (int n = 0; n < 4; ++n) people.show({{0.9, 0.3, 0}});
    int found = 0;
    for (int n = 0; n < 20; ++n)
        for (const Event& event : people.show({{0.9, 0.3, 0}, {-0.7, -0.8, 0}}).events)
            found += event.kind == EventKind::kSubjectFound && event.subject_id == 2;
    EXPECT_EQ(found, 1) << "within the interval of full passes";
    std::vector<std::uint32_t> lost;
    SceneUpdate update;
    for (int n = 0; n < 30; ++n) {
        update = people.show({{0.9, 0.3, 0}});
        for (const Event& event : update.events)
            if (event.kind == EventKind::kSubjectLost) lost.push_back(event.subject_id);
    }
    EXPECT_THAT(lost, ElementsAre(2u));
    ASSERT_THAT(update.subjects, SizeIs(1));
    EXPECT_EQ(update.subjects[0].track.subject_id, 1u);
}

// The same at each rate.
TEST(SceneTracker, ConfirmsNewcomerInTime) {
    constexpr double kConfirm_s = TrackerOptions().confirm_s, kPassInterval_s = 0.15;
    for (const double fps : {10.0, 15.0, 30.0, 120.0}) {
        People people(4, four_cameras(), fps);
        for (int n = 0; n < fps; ++n) people.show({{0.9, 0.3, 0}});
        int frames = 0;
        while (frames < fps && people.show({{0.9, 0.3, 0}, {-0.7, -0.8, 0}}).subjects.size() < 2) ++frames;
        EXPECT_GE(frames / fps, kConfirm_s) << fps;
        EXPECT_LE(frames / fps, kConfirm_s + kPassInterval_s + 1.5 / fps) << fps;
    }
}

// The events' texts of a kind.
std::vector<std::string> texts(const SceneUpdate& update, EventKind kind) {
    std::vector<std::string> out;
    for (const Event& event : update.events)
        if (event.kind == kind) out.push_back(event.message);
    return out;
}

TEST(SceneTracker, GivesOldIdToWhoReturns) {
    People people(4);
    const Vec3 stays{0.9, 0.3, 0}, left{-0.7, -0.8, 0}, returns{-0.9, 1.0, 0};
    SceneUpdate update;
    for (int n = 0; n < 45; ++n) update = people.show_dressed({red_at(stays), green_at(left)});
    ASSERT_THAT(update.subjects, SizeIs(2));
    const std::uint32_t green = People::id_at(update, left), red = People::id_at(update, stays);
    for (int n = 0; n < 40; ++n) update = people.show_dressed({red_at(stays)});
    ASSERT_THAT(update.subjects, SizeIs(1));
    std::vector<std::string> found;
    for (int n = 0; n < 25; ++n) {
        update = people.show_dressed({red_at(stays), green_at(returns)});
        for (const std::string& text : texts(update, EventKind::kSubjectFound)) found.push_back(text);
    }
    EXPECT_EQ(People::id_at(update, returns), green);
    EXPECT_EQ(People::id_at(update, stays), red);
    EXPECT_THAT(found, ElementsAre(::testing::ContainsRegex("recognised \\(9[0-9] % sure\\) at")));
}

TEST(SceneTracker, GivesNewIdToStranger) {
    People people(4);
    const Vec3 stays{0.9, 0.3, 0}, left{-0.7, -0.8, 0};
    for (int n = 0; n < 45; ++n) people.show_dressed({red_at(stays), green_at(left)});
    for (int n = 0; n < 40; ++n) people.show_dressed({red_at(stays)});
    SceneUpdate update;
    for (int n = 0; n < 25; ++n) update = people.show_dressed({red_at(stays), blue_at(left)});
    EXPECT_EQ(People::id_at(update, left), 3u);
}

// Their hulls are one part from the first frame set on.
TEST(SceneTracker, KeepsIdsWhenAnotherPersonAppearsNextToOne) {
    People people(4);
    const Vec3 stays{0.1, 0.2, 0}, far{-1.1, -0.9, 0}, appears{0.62, 0.4, 0};
    for (int n = 0; n < 10; ++n) people.show({stays, far});
    SceneUpdate update;
    for (int n = 0; n < 15; ++n) {
        update = people.show({stays, far, appears});
        EXPECT_EQ(People::id_at(update, stays), 1u) << n;
        EXPECT_EQ(People::id_at(update, far), 2u) << n;
        if (n >= 2) {
            EXPECT_EQ(update.subjects.size() + update.bystanders.size(), 3u) << n;
        }
    }
    EXPECT_EQ(People::id_at(update, appears), 3u);
}

// A stripe of the background's colour around the waist; each half alone looks like a person.
TEST(SceneTracker, KeepsSubjectWholeWhomAGapDivides) {
    People people(4);
    const Vec3 at{0.1, 0.2, 0}, far{-1.1, -0.9, 0};
    std::vector<Ellipsoid> divided = people_at({far});
    divided.push_back({{0.1, 0.2, 0.52}, {0.2, 0.2, 0.52}});
    divided.push_back({{0.1, 0.2, 1.5}, {0.33, 0.33, 0.28}});
    std::vector<Ellipsoid> whole = divided;
    whole.push_back({{0.1, 0.2, 1.3}, {0.35, 0.35, 0.4}});
    for (int n = 0; n < 10; ++n) people.show_bodies(whole);
    for (int n = 0; n < 15; ++n) {
        const SceneUpdate update = people.show_bodies(divided);
        ASSERT_THAT(update.subjects, SizeIs(2)) << n;
        EXPECT_EQ(People::id_at(update, at), 1u) << n;
        EXPECT_THAT(update.bystanders, IsEmpty()) << n;
        EXPECT_NEAR(update.subjects[0].track.centre_in_world.z, 1.05, 0.15) << n;
    }
}

// Trousers in the colour of the floor: only trunk and head are seen.
TEST(SceneTracker, FindsPersonWhoseLegsAreMissing) {
    People people(4);
    const Vec3 at{-0.7, -0.8, 0};
    std::vector<Ellipsoid> bodies = people_at({{0.9, 0.3, 0}});
    for (int n = 0; n < 4; ++n) people.show_bodies(bodies);
    bodies.push_back({{at.x, at.y, 1.25}, {0.26, 0.22, 0.4}});
    bodies.push_back({{at.x, at.y, 1.65}, {0.1, 0.1, 0.15}});
    SceneUpdate update;
    for (int n = 0; n < 8; ++n) update = people.show_bodies(bodies);
    ASSERT_NE(People::id_at(update, {at.x, at.y, 1.1}), 0u);
    for (const SceneSubject& subject : update.subjects) {
        ASSERT_TRUE(subject.lattice.has_value());
        EXPECT_LE(subject.lattice->origin[2], 0) << "the legs are searched for";
    }
}

// A raised arm is not a person without legs.
TEST(SceneTracker, StartsNoSubjectInPartWithoutATrunk) {
    People people(4);
    std::vector<Ellipsoid> bodies = people_at({{0.9, 0.3, 0}});
    bodies.push_back({{-0.7, -0.8, 1.4}, {0.1, 0.1, 0.4}});
    SceneUpdate update;
    for (int n = 0; n < 8; ++n) update = people.show_bodies(bodies);
    EXPECT_THAT(update.subjects, SizeIs(1));
}

// Who crouches has no second trunk by which the volumes of both could be divided later.
TEST(SceneTracker, KeepsNewcomerApartWhoSoonTouchesASubject) {
    People people(4);
    const Vec3 at{0.1, 0.2, 0}, beside{0.85, 0.2, 0};
    for (int n = 0; n < 10; ++n) people.show({at});
    std::vector<Ellipsoid> bodies = people_at({at});
    bodies.push_back({{beside.x, beside.y, 0.52}, {0.25, 0.25, 0.52}});
    SceneUpdate update;
    for (int n = 0; n < 6 && people.tracker().newcomers() == 0; ++n) update = people.show_bodies(bodies);
    ASSERT_THAT(update.subjects, SizeIs(1)) << "not certain yet";
    bodies.push_back({{0.45, 0.2, 0.8}, {0.25, 0.08, 0.08}});  // an arm
    for (int n = 0; n < 6; ++n) update = people.show_bodies(bodies);
    ASSERT_THAT(update.subjects, SizeIs(2));
    EXPECT_EQ(People::id_at(update, at), 1u);
    EXPECT_EQ(People::id_at(update, beside), 2u);
}

// Three cameras look across the room: its other end is far behind the wall.
TEST(SceneTracker, FindsPersonAtTheEndWhereTheCamerasStand) {
    const Vec3 at{2.75, 0, 0};
    std::vector<Camera> cameras;
    for (const auto& [eye, target] : {std::pair{Vec3{4, 2, 1.5}, Vec3{-1, 0, 1}},
                                      {Vec3{4, 0, 1.5}, Vec3{-1, 0, 1}},
                                      {Vec3{4, -2, 1.5}, Vec3{-1, 0, 1}},
                                      {Vec3{-3, 0, 2.2}, Vec3{1, 0, 0.8}}})
        cameras.push_back(camera_at(fmt::format("camera_{}", cameras.size()), eye, target, 320, 240, 180));
    People people(4, cameras);
    SceneUpdate update;
    for (int n = 0; n < 4; ++n) update = people.show({at});
    EXPECT_EQ(People::id_at(update, at), 1u);
}

// As white images show it.
TEST(SceneTracker, TakesNothingLargerThanPeopleForSubject) {
    People people(4);
    people.show({{0.1, 0.2, 0}, {-1.1, -0.9, 0}});
    SceneUpdate update;
    for (int n = 0; n < 4; ++n) update = people.show_bodies({{{0, 0, 1}, {1.6, 1.6, 1.2}}});
    for (const SceneSubject& subject : update.subjects) EXPECT_FALSE(subject.lattice.has_value());
    People first(4);
    for (int n = 0; n < 4; ++n) update = first.show_bodies({{{0, 0, 1}, {1.6, 1.6, 1.2}}});
    EXPECT_THAT(update.subjects, IsEmpty());
}

// Twice the volume, but one trunk.
TEST(SceneTracker, KeepsSubjectWholeWhoTakesUpSomethingLarge) {
    People people(4);
    const Vec3 far{-1.1, -0.9, 0};
    for (int n = 0; n < 10; ++n) people.show({{0.1, 0.2, 0}, far});
    std::vector<Ellipsoid> bodies = people_at({{0.1, 0.2, 0}, far});
    bodies.push_back({{0.1, 0.2, 1.85}, {0.5, 0.3, 0.3}});
    SceneUpdate update;
    for (int n = 0; n < 15; ++n) update = people.show_bodies(bodies);
    ASSERT_THAT(update.subjects, SizeIs(2));
    EXPECT_THAT(update.bystanders, IsEmpty());
}

TEST(SceneTracker, TracksWhoIsOutsideTheRegionsAsBystander) {
    TrackerOptions options = for_people(1);
    options.rules.capture_regions = {{{{0, -2}, {3, -2}, {3, 2}, {0, 2}}}};
    People people(options);
    const Vec3 athlete{0.9, 0.3, 0}, coach{-0.8, -0.8, 0};
    SceneUpdate update;
    for (int n = 0; n < 6; ++n) update = people.show({athlete, coach});
    ASSERT_THAT(update.subjects, SizeIs(1));
    EXPECT_NE(People::id_at(update, athlete), 0u);
    ASSERT_THAT(update.bystanders, SizeIs(1));
    EXPECT_FALSE(update.bystanders[0].shape.bricks.empty());
    const std::vector<KnownSubject> known = people.control().list();
    ASSERT_THAT(known, SizeIs(2));
    for (const KnownSubject& each : known)
        EXPECT_EQ(each.followed, each.id == update.bystanders[0].id ? Followed::kOutside : Followed::kYes);
}

TEST(SceneTracker, IgnoresOnRequestAndKeepsTheId) {
    People people(4);
    const Vec3 a{0.9, 0.3, 0}, b{-0.7, -0.8, 0};
    SceneUpdate update;
    for (int n = 0; n < 6; ++n) update = people.show({a, b});
    const std::uint32_t id = People::id_at(update, b);
    ASSERT_TRUE(people.control().set_name(id, "Anna").ok());
    ASSERT_TRUE(people.control().ignore({id}).ok());
    update = people.show({a, b});
    EXPECT_THAT(texts(update, EventKind::kSubjectLost),
                ElementsAre(::testing::HasSubstr("no longer followed (on request)")));
    for (int n = 0; n < 30; ++n) update = people.show({a, b});
    EXPECT_EQ(People::id_at(update, b), 0u);
    EXPECT_THAT(update.bystanders, SizeIs(1));
    people.control().follow_all();
    update = people.show({a, b});
    EXPECT_EQ(People::id_at(update, b), id);
    EXPECT_THAT(texts(update, EventKind::kSubjectFound), ElementsAre(::testing::HasSubstr("followed again")));
    for (const SceneSubject& subject : update.subjects)
        EXPECT_EQ(subject.track.name, subject.track.subject_id == id ? "Anna" : "");
}

TEST(SceneTracker, RestrictsVolumeToSubject) {
    People people(4);
    SceneUpdate update;
    for (int n = 0; n < 4; ++n) update = people.show({{0.5, 0, 0}, {-0.5, 0, 0}});
    ASSERT_THAT(update.subjects, SizeIs(2));
    // A block over both.
    kernels::VoxelVolume block;
    block.lattice = lattice_over({{-1, -0.3, 0.2}, {1, 0.3, 1.6}}, 0.02, 4, {0, 0, 1});
    for (int z = 0; z < block.lattice.size[2] / kernels::kBrickEdge; ++z)
        for (int y = 0; y < block.lattice.size[1] / kernels::kBrickEdge; ++y)
            for (int x = 0; x < block.lattice.size[0] / kernels::kBrickEdge; ++x) {
                kernels::Brick& brick = block.bricks.emplace_back();
                brick.x = static_cast<std::int16_t>(x), brick.y = static_cast<std::int16_t>(y),
                brick.z = static_cast<std::int16_t>(z);
                for (std::uint64_t& layer : brick.occupancy) layer = ~std::uint64_t{0};
            }
    const std::uint32_t right = People::id_at(update, {0.5, 0, 0});
    kernels::VoxelVolume own = block;
    people.tracker().restrict_to(right, own);
    ASSERT_FALSE(own.bricks.empty());
    EXPECT_LT(own.bricks.size(), block.bricks.size() / 2);
    const float brick_m = kernels::kBrickEdge * own.lattice.voxel_m;
    for (const kernels::Brick& brick : own.bricks)
        EXPECT_GT(own.lattice.origin[0] + brick_m * static_cast<float>(brick.x + 1), 0.1f);
}

// A column of cells, radius and height in m.
Cells column(const OccupiedCells& grid, Vec3 at, double radius_m, double from_m, double to_m) {
    Cells cells;
    const kernels::Lattice& lattice = grid.lattice();
    const std::int32_t count = lattice.size[0] * lattice.size[1] * lattice.size[2];
    for (std::int32_t cell = 0; cell < count; ++cell) {
        const Vec3 p = grid.centre_in_world(cell);
        if (p.z > from_m && p.z < to_m && std::hypot(p.x - at.x, p.y - at.y) < radius_m)
            cells.push_back(cell);
    }
    return cells;
}

Cells joined(Cells a, const Cells& b) {
    for (const std::int32_t cell : b)
        if (std::ranges::find(a, cell) == a.end()) a.push_back(cell);
    return a;
}

OccupiedCells grid_of(double side_m) {
    return OccupiedCells(lattice_over({{-side_m, -side_m, 0}, {side_m, side_m, 1.9}}, 0.04, 10, {0, 0, 1}));
}

int bricks_between(const kernels::Lattice& whole, const kernels::Lattice& part, int axis) {
    const float bricks = (part.origin[axis] - whole.origin[axis]) / (kernels::kBrickEdge * whole.voxel_m);
    return static_cast<int>(std::lround(bricks));
}

TEST(OccupiedCells, JoinsHalvesOfAPersonWithAGapAtTheWaist) {
    const OccupiedCells grid = grid_of(1.5);
    const Cells lower = column(grid, {-0.5, 0, 0}, 0.2, 0, 0.95),
                other = column(grid, {0.7, 0, 0}, 0.2, 0, 1.7);
    const Cells upper = column(grid, {-0.42, 0, 0}, 0.2, 1.05, 1.6);
    std::vector<Cells> parts{other, lower, upper};
    join_halves(grid, parts);
    EXPECT_THAT(parts, ElementsAre(other, joined(lower, upper)));
}

TEST(OccupiedCells, KeepsPartHighAboveAndBesideOthersApart) {
    const OccupiedCells grid = grid_of(1.5);
    const std::vector<Cells> parts{column(grid, {-0.5, 0, 0}, 0.2, 0, 0.8),
                                   column(grid, {-0.5, 0, 0}, 0.2, 1.2, 1.7),  // 0.4 m above
                                   column(grid, {0.3, 0, 0}, 0.2, 0.9, 1.4)};  // 0.8 m beside
    std::vector<Cells> after = parts;
    join_halves(grid, after);
    EXPECT_EQ(after, parts);
}

TEST(OccupiedCells, SplitsTwoTrunksThatTouch) {
    const OccupiedCells grid = grid_of(1);
    const Cells both =
        joined(column(grid, {-0.27, 0, 0}, 0.2, 0, 1.7), column(grid, {0.27, 0, 0}, 0.2, 0, 1.7));
    const Cells bridge = column(grid, {0, 0, 0}, 0.12, 1.2, 1.4);
    const auto shares = split_by_trunks(grid, joined(both, bridge));
    ASSERT_THAT(shares, SizeIs(2));
    EXPECT_NEAR(std::abs(grid.statistics(shares[0]).centre_in_world.x), 0.27, 0.04);
    EXPECT_LT(grid.statistics(shares[0]).centre_in_world.x * grid.statistics(shares[1]).centre_in_world.x, 0);
}

TEST(OccupiedCells, KeepsPersonWithSpreadArms) {
    const OccupiedCells grid = grid_of(1);
    Cells person = column(grid, {0, 0, 0}, 0.2, 0, 1.75);
    for (double x = -0.8; x <= 0.8; x += 0.04)
        person = joined(person, column(grid, {x, 0, 0}, 0.06, 1.34, 1.46));
    EXPECT_THAT(split_by_trunks(grid, person), SizeIs(1));
}

TEST(OccupiedCells, SharesContestedCellsBetweenNeighbours) {
    OccupiedCells grid = grid_of(1);
    const Cells left = column(grid, {-0.2, 0, 0}, 0.3, 0, 1.7),
                right = column(grid, {0.2, 0, 0}, 0.3, 0, 1.7);
    grid.add(grid.volume_of(joined(left, right)));
    grid.give(left, {0, 0, 0}, 1);
    grid.give(right, {0, 0, 0}, 2);
    grid.flood(20);
    EXPECT_THAT(grid.parts(OccupiedCells::kFree), IsEmpty());
    EXPECT_EQ(grid.label_at({-0.3, 0, 1}), 1);
    EXPECT_EQ(grid.label_at({0.3, 0, 1}), 2);
    EXPECT_EQ(grid.label_at({-0.06, 0, 1}), 1);
    EXPECT_EQ(grid.label_at({0.06, 0, 1}), 2);
    EXPECT_EQ(grid.label_at({5, 0, 1}), OccupiedCells::kEmpty);
}

// Two people, and the right one's arm; its hand has the label of the left one.
struct TakenHand {
    OccupiedCells grid = grid_of(1);
    std::vector<std::vector<Cells>> parts;

    explicit TakenHand(double hand_at_x) {
        const Cells left = column(grid, {-0.6, 0, 0}, 0.2, 0, 1.7),
                    right = column(grid, {0.6, 0, 0}, 0.2, 0, 1.7);
        Cells arm, hand;
        for (double x = hand_at_x; x <= 0.6; x += 0.04) {
            Cells& limb = x < hand_at_x + 0.15 ? hand : arm;
            limb = joined(limb, column(grid, {x, 0, 0}, 0.06, 1.34, 1.46));
        }
        grid.add(grid.volume_of(joined(joined(left, right), joined(arm, hand))));
        grid.give(joined(left, hand), {0, 0, 0}, 1);
        grid.give(joined(right, arm), {0, 0, 0}, 2);
        parts = {grid.parts(1), grid.parts(2)};
    }
};

TEST(OccupiedCells, ReturnsHandThatTouchesOnlyItsOwnArm) {
    TakenHand people(-0.1);
    ASSERT_THAT(people.parts[0], SizeIs(2));
    return_limbs(people.grid, people.parts);
    EXPECT_THAT(people.parts[0], SizeIs(1));
    EXPECT_EQ(people.grid.parts(1), people.parts[0]);
    ASSERT_THAT(people.parts[1], SizeIs(1));
    EXPECT_EQ(people.grid.parts(2)[0].size(), people.parts[1][0].size());
    EXPECT_EQ(people.grid.label_at({-0.05, 0, 1.4}), 2);
}

// It may be a shank that a gap in the silhouettes cuts off.
TEST(OccupiedCells, KeepsPartNearTheRestOfItsSubject) {
    TakenHand people(-0.3);
    const auto before = people.parts;
    ASSERT_THAT(before[0], SizeIs(2));
    return_limbs(people.grid, people.parts);
    EXPECT_EQ(people.parts, before);
}

TEST(OccupiedCells, KeepsPartThatTouchesNoOtherSubject) {
    OccupiedCells grid = grid_of(1);
    const Cells body = column(grid, {-0.6, 0, 0}, 0.2, 0, 1.7), foot = column(grid, {0, 0, 0}, 0.1, 0, 0.1);
    grid.add(grid.volume_of(joined(body, foot)));
    grid.give(joined(body, foot), {0, 0, 0}, 1);
    std::vector<std::vector<Cells>> parts{grid.parts(1)};
    return_limbs(grid, parts);
    EXPECT_THAT(parts[0], SizeIs(2));
}

// Seen from the x axis, the body at +x hides the other one.
TEST(SubjectViews, MarksSharedForegroundAndWhoHidesWhom) {
    const std::vector<Camera> cameras{camera_at("front", {4, 0, 1.2}, {0, 0, 1}),
                                      camera_at("side", {0, 4, 1.2}, {0, 0, 1})};
    std::vector<kernels::CameraModel> models;
    std::vector<kernels::Silhouettes> silhouettes;
    for (const Camera& camera : cameras) {
        models.push_back(to_kernel(camera));
        silhouettes.push_back(silhouettes_of(camera, people_at({{0.8, 0, 0}, {-0.8, 0, 0}})));
    }
    const OccupiedCells grid = grid_of(1.4);
    const kernels::VoxelVolume near = grid.volume_of(column(grid, {0.8, 0, 0}, 0.2, 0.05, 1.7)),
                               far = grid.volume_of(column(grid, {-0.8, 0, 0}, 0.2, 0.05, 1.7));
    const std::vector<const kernels::VoxelVolume*> shapes{&near, &far};
    SubjectViews of_near, of_far;
    std::vector<SubjectViews*> out{&of_near, &of_far};
    SubjectSeparator().separate(cameras, models, silhouettes, shapes, out);
    EXPECT_EQ(of_near.hidden_fraction[0], 0);
    EXPECT_GT(of_far.hidden_fraction[0], 0.7f);
    EXPECT_FALSE(of_near.shared[0].box.empty());
    EXPECT_TRUE(of_near.shared[1].box.empty()) << "apart in the camera at the side";
    EXPECT_EQ(of_far.hidden_fraction[1], 0);
    EXPECT_NEAR(static_cast<double>(of_near.own[1].sharp_pixels + of_far.own[1].sharp_pixels),
                static_cast<double>(silhouettes[1].sharp_pixels),
                0.03 * static_cast<double>(silhouettes[1].sharp_pixels));
}

TEST(OccupiedCells, TakesPartsOfItsLatticeThatOverlap) {
    OccupiedCells whole = grid_of(1.4), parts = grid_of(1.4);
    const Cells person = column(whole, {0.3, -0.2, 0}, 0.2, 0.05, 1.7);
    const kernels::VoxelVolume volume = whole.volume_of(person);
    whole.add(volume);
    for (const double x : {0.1, 0.5}) {
        const kernels::Lattice part = parts.part_over({{x - 0.3, -0.6, 0}, {x + 0.3, 0.2, 5}});
        ASSERT_LT(part.size[0], volume.lattice.size[0]);
        kernels::VoxelVolume clipped{part, {}, {}};
        for (kernels::Brick brick : volume.bricks) {
            brick.x = static_cast<std::int16_t>(brick.x - bricks_between(volume.lattice, part, 0));
            brick.y = static_cast<std::int16_t>(brick.y - bricks_between(volume.lattice, part, 1));
            if (brick.x >= 0 && brick.x < part.size[0] / kernels::kBrickEdge && brick.y >= 0 &&
                brick.y < part.size[1] / kernels::kBrickEdge)
                clipped.bricks.push_back(brick);
        }
        parts.add(clipped);
    }
    const std::vector<Cells> found = parts.parts(OccupiedCells::kFree);
    ASSERT_EQ(found.size(), 1u);
    Cells cells = found[0];
    std::ranges::sort(cells);
    EXPECT_EQ(cells, person);
    EXPECT_EQ(parts.part_over({{7, 7, 0}, {8, 8, 1}}).size[0], 0);
    parts.clear();
    EXPECT_TRUE(parts.parts(OccupiedCells::kFree).empty());
}

// Two people at y = -0.6 and 0.6 seen from the x axis, the first one's volume without its waist, and another
// body that is in no volume. Returns the own pixels of each.
std::array<std::int64_t, 2> own_pixels(const std::vector<Ellipsoid>& another) {
    const std::vector<Camera> cameras{camera_at("front", {4, 0, 1.2}, {0, 0, 1})};
    const std::vector<kernels::CameraModel> models{to_kernel(cameras[0])};
    std::vector<Ellipsoid> bodies = people_at({{0, -0.6, 0}, {0, 0.6, 0}});
    bodies.insert(bodies.end(), another.begin(), another.end());
    const std::vector silhouettes{silhouettes_of(cameras[0], bodies)};
    const OccupiedCells grid = grid_of(1.4);
    const Cells legs = column(grid, {0, -0.6, 0}, 0.22, 0.05, 0.85),
                chest = column(grid, {0, -0.6, 0}, 0.22, 1.05, 1.7);
    const kernels::VoxelVolume first = grid.volume_of(joined(legs, chest)),
                               second = grid.volume_of(column(grid, {0, 0.6, 0}, 0.22, 0.05, 1.7));
    const std::vector<const kernels::VoxelVolume*> shapes{&first, &second};
    SubjectViews of_first, of_second;
    std::vector<SubjectViews*> views{&of_first, &of_second};
    SubjectSeparator().separate(cameras, models, silhouettes, shapes, views);
    return {of_first.own[0].sharp_pixels, of_second.own[0].sharp_pixels};
}

TEST(SubjectSeparator, KeepsForegroundWhereTheVolumeLacksAPart) {
    const auto [first, second] = own_pixels({});
    EXPECT_NEAR(static_cast<double>(first), static_cast<double>(second), 0.02 * static_cast<double>(second));
}

TEST(SubjectSeparator, LeavesOutForegroundBetweenTwoSubjects) {
    const auto [first_apart, second_apart] = own_pixels({});
    const auto [first, second] = own_pixels({{{0, 0, 1.2}, {0.04, 0.6, 0.06}}});
    EXPECT_LT(first, first_apart + first_apart / 20);
    EXPECT_LT(second, second_apart + second_apart / 20);
}

TEST(SubjectSeparator, LeavesOutAnotherBodyBesideASubject) {
    const auto [alone, second] = own_pixels({});
    const auto [beside, same] = own_pixels(people_at({{0, -0.95, 0}}));
    EXPECT_LT(beside, alone + alone / 20);
    EXPECT_EQ(same, second);
}

// The subjects stand elsewhere in the second frame set.
TEST(SubjectSeparator, LeavesNoTraceOfAnEarlierFrameSetInReusedViews) {
    const std::vector<Camera> cameras{camera_at("front", {4, 0, 1.2}, {0, 0, 1})};
    const std::vector<kernels::CameraModel> models{to_kernel(cameras[0])};
    const OccupiedCells grid = grid_of(1.4);
    SubjectSeparator separator;
    std::vector<SubjectViews> reused(2), fresh(2);
    const auto separate = [&](SubjectSeparator& with, const Vec3& a, const Vec3& b,
                              std::vector<SubjectViews>& out) {
        const std::vector silhouettes{silhouettes_of(cameras[0], people_at({a, b}))};
        const kernels::VoxelVolume of_a = grid.volume_of(column(grid, a, 0.2, 0.05, 1.7)),
                                   of_b = grid.volume_of(column(grid, b, 0.2, 0.05, 1.7));
        const std::vector<const kernels::VoxelVolume*> shapes{&of_a, &of_b};
        std::vector<SubjectViews*> views{&out[0], &out[1]};
        with.separate(cameras, models, silhouettes, shapes, views);
    };
    separate(separator, {0.8, 0, 0}, {-0.8, 0.2, 0}, reused);
    separate(separator, {0.5, 0.7, 0}, {-0.5, 0.6, 0}, reused);
    SubjectSeparator other;
    separate(other, {0.5, 0.7, 0}, {-0.5, 0.6, 0}, fresh);
    for (int n = 0; n < 2; ++n) {
        EXPECT_EQ(reused[n].own[0].sharp, fresh[n].own[0].sharp);
        EXPECT_EQ(reused[n].own[0].loose, fresh[n].own[0].loose);
        EXPECT_EQ(reused[n].own[0].bounds, fresh[n].own[0].bounds);
        EXPECT_EQ(reused[n].own[0].sharp_pixels, fresh[n].own[0].sharp_pixels);
        ASSERT_FALSE(fresh[n].shared[0].box.empty());
        EXPECT_EQ(reused[n].shared[0].box, fresh[n].shared[0].box);
        EXPECT_EQ(reused[n].shared[0].mask, fresh[n].shared[0].mask);
    }
}

}  // namespace
}  // namespace kinevox
