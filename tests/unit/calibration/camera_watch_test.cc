// A camera that moves during a capture is reported, and no other.
#include "server/calibration/procedure/camera_watch.h"

#include <gtest/gtest.h>

#include <chrono>
#include <random>

#include "server/cameras/studio/studio.h"

namespace kinevox {
namespace {

constexpr double kFps = 10, kBump_s = 2;

std::unique_ptr<studio::Studio> make_studio(std::optional<studio::CameraBump> bump) {
    studio::StudioOptions options;
    options.width = 320, options.height = 240, options.fps = kFps;
    options.staging.bump = bump;
    auto made = studio::Studio::create(options);
    EXPECT_TRUE(made.ok()) << made.status();
    return made.ok() ? *std::move(made) : nullptr;
}

kernels::Rect box_of(const std::vector<std::uint8_t>& mask, int width) {
    kernels::Rect box{width, 1 << 20, 0, 0};
    for (std::size_t i = 0; i < mask.size(); ++i) {
        if (!mask[i]) continue;
        const int x = static_cast<int>(i) % width, y = static_cast<int>(i) / width;
        box = {std::min(box.x0, x), std::min(box.y0, y), std::max(box.x1, x + 1), std::max(box.y1, y + 1)};
    }
    return box.x0 < box.x1 ? box : kernels::Rect{};
}

TEST(StaticScene, MeasuresRotationOfTheBumpedCameraOnly) {
    const struct {
        std::size_t camera;
        double rotation_deg;
    } table[] = {{0, 0.5}, {1, -0.5}, {2, 1.0}, {3, -2.0}};
    for (const auto& row : table) {
        SCOPED_TRACE(row.camera);
        const auto studio = make_studio(studio::CameraBump{row.camera, kBump_s, row.rotation_deg});
        ASSERT_TRUE(studio);
        std::vector<StaticScene> scenes;
        std::vector<CameraMotionState> verdicts(4);
        for (const Camera& camera : studio->cameras()) scenes.emplace_back(camera);
        std::vector<int> named_at(4, -1);
        for (int frame = 0; frame < 50; frame += 5) {
            const auto images = studio->draw(frame, true);
            const auto masks = studio->masks(frame);
            for (std::size_t c = 0; c < 4; ++c) {
                const auto shift = scenes[c].measure(images[c], box_of(masks[c], 320));
                if (shift && (c != row.camera || frame < kBump_s * kFps)) {
                    EXPECT_LT(shift->rotation_deg, 0.06) << c << " " << frame;
                }
                if (verdicts[c].add(shift, studio->cameras()[c].name, {}) ==
                    CameraMotionState::Change::kMoved)
                    named_at[c] = frame;
            }
        }
        for (std::size_t c = 0; c < 4; ++c) {
            EXPECT_EQ(verdicts[c].camera().suspect, c == row.camera) << c;
            EXPECT_EQ(verdicts[c].camera().reason.find(studio->cameras()[c].name) != std::string::npos,
                      c == row.camera);
        }
        EXPECT_GE(named_at[row.camera], kBump_s * kFps);
        EXPECT_LE(named_at[row.camera], kBump_s * kFps + 2 * kFps);
    }
}

// A person in front of a plain wall, of whom the box leaves out the upper part.
Image plain_wall(double person_x_px, std::mt19937& random) {
    constexpr int kWidth = 320, kHeight = 240;
    const std::shared_ptr<std::uint8_t[]> pixels(new std::uint8_t[kWidth * kHeight]);
    for (int y = 0; y < kHeight; ++y)
        for (int x = 0; x < kWidth; ++x) {
            const double across = std::abs(x - person_x_px), width_px = y < 90 ? 14 : 28;
            const bool person = y > 60 && y < 210 && across < width_px;
            const int grey = person ? 60 + 40 * (y / 12 % 2) : 100;
            pixels[y * kWidth + x] = static_cast<std::uint8_t>(grey + static_cast<int>(random() % 5));
        }
    return {kWidth, kHeight, 1, pixels};
}

TEST(StaticScene, PersonWhoMovesInFrontOfPlainWallIsNoRotation) {
    const auto studio = make_studio(std::nullopt);
    ASSERT_TRUE(studio);
    std::mt19937 random(3);
    StaticScene scene(studio->cameras()[0]);
    CameraMotionState state;
    for (int check = 0; check < 30; ++check) {
        const double x = 160 + 5 * check;
        const auto shift = scene.measure(plain_wall(x, random),
                                         {static_cast<int>(x) - 28, 100, static_cast<int>(x) + 28, 210});
        EXPECT_EQ(state.add(shift, "cam1", {}), CameraMotionState::Change::kNone);
    }
}

TEST(StaticScene, EmptyIfTheSceneIsHiddenOrTheImageMissing) {
    const auto studio = make_studio(std::nullopt);
    ASSERT_TRUE(studio);
    StaticScene scene(studio->cameras()[0]);
    EXPECT_FALSE(scene.measure({}, {}));
    const auto images = studio->draw(0, true);
    EXPECT_TRUE(scene.measure(images[0], {}));
    EXPECT_FALSE(scene.measure(images[0], {0, 0, 320, 240}));
}

TEST(CameraMotionState, IgnoresOneOutlierAndClearsRestoredCamera) {
    using Change = CameraMotionState::Change;
    CameraMotionState verdict;
    const SceneShift still{0.01, 0.1, 0}, moved{0.5, 5, 0.8}, light{0.5, 5, 0.1};
    EXPECT_EQ(verdict.add(moved, "cam1", {}), Change::kNone);
    EXPECT_EQ(verdict.add(still, "cam1", {}), Change::kNone);
    EXPECT_EQ(verdict.add(moved, "cam1", {}), Change::kNone);
    EXPECT_EQ(verdict.add(std::nullopt, "cam1", {}), Change::kNone);
    EXPECT_EQ(verdict.add(light, "cam1", {}), Change::kNone);
    EXPECT_EQ(verdict.add(light, "cam1", {}), Change::kNone);
    EXPECT_FALSE(verdict.camera().suspect);
    EXPECT_EQ(verdict.add(moved, "cam1", {}), Change::kNone);
    EXPECT_EQ(verdict.add(moved, "cam1", {}), Change::kMoved);
    EXPECT_NE(verdict.camera().reason.find("0.5 degrees"), std::string::npos);
    EXPECT_EQ(verdict.add(still, "cam1", {}), Change::kNone);
    EXPECT_EQ(verdict.add(still, "cam1", {}), Change::kRestored);
    EXPECT_TRUE(verdict.camera().reason.empty());
}

TEST(CameraWatch, ReportsMovedCameraByEventAndStatus) {
    const auto studio = make_studio(studio::CameraBump{2, kBump_s, 0.7});
    ASSERT_TRUE(studio);
    std::mutex mutex;
    std::condition_variable changed;
    std::vector<Event> events;
    CameraWatch watch(studio->cameras(), {}, [&](const Event& event) {
        const std::scoped_lock lock(mutex);
        events.push_back(event);
        changed.notify_all();
    });
    EXPECT_FALSE(watch.cameras()[2].shift_px);
    std::unique_lock lock(mutex);
    // Checks may be late on a loaded machine and skip frame sets: wait for each.
    const auto show = [&](int frame, const auto& until) {
        FrameResult result;
        result.sequence = static_cast<std::uint64_t>(frame);
        result.capture_time_ns = static_cast<std::int64_t>(1e9 * frame / kFps);
        result.frame_set.images = studio->draw(frame, true);
        const auto masks = studio->masks(frame);
        result.silhouettes.resize(4);
        for (std::size_t c = 0; c < 4; ++c) result.silhouettes[c].bounds = box_of(masks[c], 320);
        watch.observe(result);
        changed.wait_for(lock, std::chrono::milliseconds(200), until);
    };
    const auto looked = [&] { return watch.cameras()[3].shift_px.has_value(); };
    const auto named = [&] { return !events.empty(); };
    for (int frame = 0; frame < kBump_s * kFps && !looked(); ++frame) show(frame, looked);
    ASSERT_TRUE(looked());
    for (int look = 0; look < 100 && !named(); ++look)
        show(static_cast<int>(kBump_s * kFps) + 5 * look, named);
    ASSERT_TRUE(named());
    EXPECT_EQ(events.size(), 1u);
    EXPECT_EQ(events[0].kind, EventKind::kCameraMoved);
    EXPECT_EQ(events[0].camera, studio->cameras()[2].name);
    lock.unlock();
    const auto cameras = watch.cameras();
    EXPECT_TRUE(cameras[2].suspect);
    EXPECT_FALSE(cameras[0].suspect);
    ASSERT_TRUE(cameras[2].shift_px);
    EXPECT_GT(*cameras[2].shift_px, 1.5);
}

}  // namespace
}  // namespace kinevox
