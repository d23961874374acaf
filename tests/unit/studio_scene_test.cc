// Scene files of the virtual studio, and what they vary: body, room, light, shadows, sensor and cameras.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <string>

#include "common/body_table.h"
#include "server/cameras/studio/scene_file.h"

namespace kinevox::studio {
namespace {

using ::testing::HasSubstr;

constexpr char kScene[] = R"(
seed = 5
fps = 12.5
frames = 9
background_frames = 4
crf = 17
[motion]
name = "kick"
speed = 0.8
start_s = 0.5
yaw_deg = 40.0
shift_m = [0.2, -0.1]
[subject]
stature_m = 1.62
girth = 1.1
femininity = 0.5
belly = 0.4
leg_scale = 1.05
cloth_grain = 0.0
shirt_pattern = "plain"
shirt = [0.3, 0.3, 0.3]
trousers = [0.1, 0.1, 0.12]
long_sleeves = true
[room]
floor = "concrete"
floor_colour = [0.2, 0.2, 0.22]
floor_grain = 0.0
walls = "paint"
wall_colour = [0.5, 0.5, 0.5]
wall_grain = 0.0
furniture = false
decals = false
[light]
key_fraction = 0.5
key_position_m = [2.4, 0.3, 2.2]
key_half_m = 0.2
flicker = 0.0
[sensor]
noise_grey = 0.0
[[camera]]
position_m = [0.5, -3.9, 1.4]
size_px = [320, 240]
zoom = 0.6
roll_deg = 3.0
distortion = [-0.1, 0.02, 0.0, 0.0, 0.0]
[[camera]]
position_m = [3.0, 3.0, 2.0]
size_px = [400, 240]
)";

Scene scene() {
    const auto read = parse_scene(kScene, "scene.toml");
    EXPECT_TRUE(read.ok()) << read.status().message();
    return read.ok() ? *read : Scene{};
}

std::unique_ptr<Studio> studio_of(const StudioOptions& options) {
    auto studio = Studio::create(options);
    EXPECT_TRUE(studio.ok()) << studio.status().message();
    return studio.ok() ? *std::move(studio) : nullptr;
}

Vec3 joint_at(const SubjectTruth& truth, std::string_view name) {
    return truth.joints_in_world[static_cast<std::size_t>(
        std::find(kJointNames.begin(), kJointNames.end(), name) - kJointNames.begin())];
}

// Mean grey level of `image` over pixels for which `counts(x, y)`.
template <typename Counts>
double mean_grey(const Image& image, Counts counts) {
    double sum = 0;
    int pixels = 0;
    for (int y = 0; y < image.height; ++y)
        for (int x = 0; x < image.width; ++x)
            if (counts(x, y)) sum += image.data[3 * (y * image.width + x) + 1], ++pixels;
    return pixels > 0 ? sum / pixels : -1;
}

TEST(SceneFile, ReadsWhatItSays) {
    const Scene read = scene();
    EXPECT_EQ(read.writer.frames, 9);
    EXPECT_EQ(read.writer.crf, 17);
    EXPECT_EQ(read.studio.seed, 5u);
    EXPECT_EQ(read.studio.motion, "kick");
    EXPECT_EQ(read.studio.motion_shift.y, -0.1);
    EXPECT_EQ(read.studio.subject.girth, 1.1);
    EXPECT_EQ(read.studio.subject.pattern, ShirtPattern::kPlain);
    EXPECT_TRUE(read.studio.light.area_shadows);
    const auto studio = studio_of(read.studio);
    ASSERT_EQ(studio->cameras().size(), 2u);
    EXPECT_EQ(studio->cameras()[1].width, 400);
    EXPECT_NEAR(studio->cameras()[0].centre_in_world().y, -3.9, 1e-9);
    EXPECT_EQ(studio->cameras()[0].k1, -0.1);
}

TEST(SceneFile, NamesFileAndKeyOfWhatIsWrong) {
    const auto message = [](std::string text) {
        return std::string(parse_scene(text, "scene.toml").status().message());
    };
    EXPECT_THAT(message("frame = 3\n"), HasSubstr("frame"));
    EXPECT_THAT(message("[subject]\ngirth = 3.0\n"), HasSubstr("scene.toml:2"));
    EXPECT_THAT(message("[room]\nfloor = \"lava\"\n"), HasSubstr("lava"));
    EXPECT_THAT(message("[[camera]]\nzoom = 1.0\n"), HasSubstr("position_m"));
    EXPECT_THAT(message("[light]\nkey_fraction = 0.9\npanels_fraction = 0.4\n"), HasSubstr("0.95"));
}

// Seen along x, the second person stands behind the first one; the third enters later.
TEST(SceneFile, RendersFurtherPeople) {
    const auto read = parse_scene(R"(
seed = 3
fps = 10
frames = 4
[motion]
name = "stand"
shift_m = [1.0, 0.0]
[[person]]
[person.motion]
name = "stand"
shift_m = [-1.0, 0.0]
[[person]]
[person.subject]
stature_m = 1.6
[person.motion]
name = "stand"
shift_m = [0.0, 1.5]
enter_s = 0.2
leave_s = 0.5
return_s = 1.0
[[camera]]
position_m = [4.5, 0.0, 1.2]
size_px = [320, 240]
[[camera]]
position_m = [0.0, -4.5, 1.2]
size_px = [320, 240]
)",
                                  "scene.toml");
    ASSERT_TRUE(read.ok()) << read.status().message();
    const auto studio = studio_of(read->studio);
    ASSERT_EQ(studio->person_count(), 3u);
    EXPECT_FALSE(studio->is_present(2, 1));
    EXPECT_TRUE(studio->is_present(2, 2));
    const auto leaves = static_cast<std::int64_t>(std::lround(0.5 * read->studio.fps));
    EXPECT_FALSE(studio->is_present(2, leaves));
    EXPECT_FALSE(studio->is_present(2, 2 * leaves - 1));
    EXPECT_TRUE(studio->is_present(2, 2 * leaves));
    const auto count = [&](std::int64_t frame, std::size_t camera, int label) {
        const auto labels = studio->labels(frame);
        return std::ranges::count(labels[camera], static_cast<std::uint8_t>(label));
    };
    EXPECT_GT(count(0, 1, 1), 600) << "the camera at the side sees both";
    EXPECT_GT(count(0, 1, 2), 600);
    EXPECT_LT(count(0, 0, 2), count(0, 0, 1) / 4) << "the nearer person hides the other one";
    EXPECT_EQ(count(0, 1, 3), 0);
    EXPECT_GT(count(2, 1, 3), 500);
    EXPECT_NEAR(joint_at(studio->truth(0, 1), "root").x, -1, 0.1);
    EXPECT_EQ(std::ranges::count(studio->masks(0)[0], 255), count(0, 0, 1) + count(0, 0, 2));
}

TEST(SceneFile, SameSceneGivesSameBits) {
    const auto a = studio_of(scene().studio), b = studio_of(scene().studio);
    (void)b->draw(5, true);
    const auto one = a->draw(2, false), other = b->draw(2, true);
    for (std::size_t c = 0; c < one.size(); ++c)
        EXPECT_EQ(std::memcmp(one[c].data.get(), other[c].data.get(),
                              static_cast<std::size_t>(3) * one[c].width * one[c].height),
                  0);
}

TEST(SceneBody, LongerLegsLeaveTheStature) {
    StudioOptions options = scene().studio;
    options.motion = "stand";
    options.motion_start_s = 0;
    double top[2], thigh[2];
    for (const int longer : {0, 1}) {
        options.subject.leg_scale = longer ? 1.06 : 0.94;
        const SubjectTruth truth = studio_of(options)->truth(0);
        top[longer] = joint_at(truth, "head_top").z;
        thigh[longer] = norm(joint_at(truth, "hip_l") - joint_at(truth, "knee_l"));
    }
    EXPECT_NEAR(top[0], top[1], 0.015);
    EXPECT_NEAR(thigh[1] / thigh[0], 1.06 / 0.94, 0.001);
}

TEST(SceneBody, PlainClothOfTheFloorsColourHasItsColour) {
    StudioOptions options = scene().studio;
    options.motion = "stand";
    options.subject.trousers = options.room.floor_colour;
    const auto studio = studio_of(options);
    const Image image = studio->draw(0, false)[0], empty = studio->draw_empty(0, 0);
    const auto mask = studio->masks(0)[0];
    const Camera& camera = studio->cameras()[0];
    const auto knee = camera.project(joint_at(studio->truth(0), "knee_l"));
    const auto near_knee = [&](int x, int y) {
        return mask[y * camera.width + x] != 0 && std::hypot(x - knee->x, y - knee->y) < 6;
    };
    const double cloth = mean_grey(image, near_knee), behind = mean_grey(empty, near_knee);
    EXPECT_GT(cloth / behind, 0.4);
    EXPECT_LT(cloth / behind, 1.1);
}

// The shadow of a lamp on a stand falls on the wall behind the subject, fades at its edge and never lightens.
TEST(AreaShadow, FallsOnFloorAndWallWithSoftEdges) {
    StudioOptions options = scene().studio;
    options.motion = "stand";
    options.motion_shift = {-2.5, 0, 0};  // the lamp is at x = 2.4, the wall at x = -5.2
    options.placed_cameras.resize(1);
    options.placed_cameras[0] = {
        .position_in_world = {1.5, -3.5, 1.6}, .width = 320, .height = 240, .zoom = 0.5};
    const auto studio = studio_of(options);
    const Image image = studio->draw(0, false)[0], empty = studio->draw_empty(0, 0);
    const auto mask = studio->masks(0)[0];
    const Camera& camera = studio->cameras()[0];
    int floor_dark = 0, wall_dark = 0, faint = 0, brighter = 0;
    for (int y = 1; y + 1 < image.height; ++y)
        for (int x = 1; x + 1 < image.width; ++x) {
            const int i = y * image.width + x;
            if (mask[i] || mask[i - 1] || mask[i + 1] || mask[i - image.width] || mask[i + image.width])
                continue;
            const int loss = empty.data[3 * i + 1] - image.data[3 * i + 1];
            const Ray ray = camera.ray_through({static_cast<double>(x), static_cast<double>(y)});
            const double to_wall = (-5.2 - ray.origin_in_world.x) / ray.direction_in_world.x;
            const double height = ray.origin_in_world.z + to_wall * ray.direction_in_world.z;
            const bool wall = to_wall > 0 && height > 0.15 && height < 3.8;
            brighter += loss < -2;
            faint += loss >= 2 && loss < 8;
            (wall ? wall_dark : floor_dark) += loss > 8;
        }
    EXPECT_GT(floor_dark, 60);
    EXPECT_GT(wall_dark, 60);
    EXPECT_GT(faint, 100);
    EXPECT_EQ(brighter, 0);
}

TEST(SceneSensor, ShotNoiseGrowsWithLight) {
    StudioOptions options = scene().studio;
    options.noise_grey = 0.5;
    options.shot_noise_grey = 3;
    const auto studio = studio_of(options);
    const Image a = studio->draw_empty(0, 0), b = studio->draw_empty(0, 1);
    double sum[2] = {0, 0};
    int count[2] = {0, 0};
    for (int i = 0; i < 3 * a.width * a.height; ++i) {
        if (a.data[i] < 20 || a.data[i] > 220) continue;
        const int bright = a.data[i] > 145 ? 1 : a.data[i] < 110 ? 0 : -1;
        if (bright < 0) continue;
        const double d = a.data[i] - b.data[i];
        sum[bright] += d * d, ++count[bright];
    }
    ASSERT_GT(count[0], 500);
    ASSERT_GT(count[1], 500);
    EXPECT_GT(std::sqrt(sum[1] / count[1]), 1.15 * std::sqrt(sum[0] / count[0]));
}

TEST(SceneMotion, SpeedStartAndYawMoveTheSubject) {
    StudioOptions options = scene().studio;
    options.motion = "walk";
    options.motion_start_s = 0, options.motion_speed = 1, options.motion_yaw_deg = 0,
    options.motion_shift = {};
    options.fps = 10;
    const auto plain = studio_of(options);
    options.motion_speed = 2, options.motion_yaw_deg = 90, options.motion_start_s = 1;
    const auto moved = studio_of(options);
    const Vec3 a = joint_at(plain->truth(30), "root"), b = joint_at(moved->truth(10), "root");
    EXPECT_NEAR(b.x, -a.y, 1e-9);
    EXPECT_NEAR(b.y, a.x, 1e-9);
    EXPECT_NEAR(b.z, a.z, 1e-9);
}

}  // namespace
}  // namespace kinevox::studio
