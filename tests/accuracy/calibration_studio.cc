// Calibration in the virtual studio against ground truth: a board and a wand with 4 and 8 cameras, with noise
// and distortion, and the duration of a large solve.
//   calibration_studio [board|wand|time ...]      default: all
// Prints a table; exit status 1 beyond the bounds.
#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <chrono>
#include <cmath>
#include <random>
#include <string>

#include "common/geometry.h"
#include "common/stopwatch.h"
#include "server/calibration/board/board_detector.h"
#include "server/calibration/board/extrinsics.h"
#include "server/calibration/multi_view.h"
#include "server/calibration/wand/wand.h"
#include "server/cameras/studio/staging.h"
#include "server/cameras/studio/studio.h"

namespace kinevox {
namespace {

constexpr double kMaxCentreMm = 5, kMaxRotationDeg = 0.1, kMaxScaleFraction = 0.002, kMaxSeconds = 20;
constexpr double kNoiseGrey = 1.4, kDistortion = 0.08;
const Vec3 kLower{-1.2, -1.2, 0.4}, kUpper{1.2, 1.2, 1.9};

struct Errors {
    double centre_mm = 0, rotation_deg = 0, scale_fraction = 0;
};

// After rigid alignment; the scale is not corrected.
Errors errors_against(const std::vector<Camera>& truth, std::vector<Camera> solved) {
    std::vector<Vec3> from, to;
    for (std::size_t c = 0; c < truth.size(); ++c) {
        from.push_back(solved[c].centre_in_world());
        to.push_back(truth[c].centre_in_world());
    }
    Errors errors;
    errors.scale_fraction = std::abs(1 - align_points(from, to, true)->scale);
    move_cameras(*align_points(from, to, false), solved);
    for (std::size_t c = 0; c < truth.size(); ++c) {
        errors.centre_mm =
            std::max(errors.centre_mm, 1000 * norm(solved[c].centre_in_world() - truth[c].centre_in_world()));
        errors.rotation_deg =
            std::max(errors.rotation_deg, degrees(angle_between(solved[c].camera_from_world.rotation,
                                                                truth[c].camera_from_world.rotation)));
    }
    return errors;
}

std::vector<Camera> without_extrinsics(std::vector<Camera> cameras) {
    for (Camera& camera : cameras) camera.camera_from_world = {};
    return cameras;
}

std::unique_ptr<studio::Studio> make_studio(int cameras) {
    studio::StudioOptions options;
    options.cameras = cameras;
    options.width = 1280, options.height = 960;
    options.noise_grey = kNoiseGrey, options.distortion = kDistortion;
    auto made = studio::Studio::create(options);
    return made.ok() ? *std::move(made) : nullptr;
}

absl::StatusOr<ExtrinsicsResult> by_board(studio::Studio& studio, int frame_sets) {
    const BoardSpec board = *parse_board("charuco:6x5:160:120:DICT_4X4_100");
    auto print_detector = BoardDetector::create(board);
    if (!print_detector.ok()) return print_detector.status();
    studio::Print print;
    print.pixels_per_m = 1000;
    print.grey = (*print_detector)->draw(print.pixels_per_m, print.origin_px);
    const std::vector<Camera>& cameras = studio.cameras();
    std::vector<std::vector<BoardDetection>> detections(cameras.size(),
                                                        std::vector<BoardDetection>(frame_sets));
    oneapi::tbb::parallel_for(std::size_t{0}, cameras.size(), [&](std::size_t c) {
        auto detector = BoardDetector::create(board);
        const Image empty = studio.draw_empty(c, 0);
        for (int m = 0; m < frame_sets; ++m) {
            const Rigid3 pose = studio::held_board(cameras, kLower, kUpper, {0.48, 0.40, 0}, m, 5);
            detections[c][m] = (*detector)->detect(studio::draw_print(
                empty, cameras[c], print, pose, kNoiseGrey, static_cast<std::uint32_t>(97 * m + 7 * c)));
        }
    });
    ExtrinsicsOptions options;
    options.solve_delays = false;  // frame sets are unrelated
    ExtrinsicsProcedure procedure(without_extrinsics(cameras), board, options);
    for (std::size_t c = 0; c < cameras.size(); ++c)
        for (int m = 0; m < frame_sets; ++m)
            procedure.add_observation(m, static_cast<int>(c), detections[c][m]);
    return procedure.solve();
}

absl::StatusOr<ExtrinsicsResult> by_wand(studio::Studio& studio, int frame_sets) {
    const WandSpec wand;
    const std::vector<Camera>& cameras = studio.cameras();
    std::vector<std::vector<WandDetection>> detections(cameras.size(),
                                                       std::vector<WandDetection>(frame_sets));
    oneapi::tbb::parallel_for(std::size_t{0}, cameras.size(), [&](std::size_t c) {
        const Image empty = studio.draw_empty(c, 0);
        for (int m = 0; m < frame_sets; ++m) {
            const Rigid3 pose = studio::held_board(cameras, kLower, kUpper, {0.3, 0, 0}, m, 11);
            std::vector<studio::Ball> balls;
            for (const double along : {0.0, wand.middle_m, wand.length_m})
                balls.push_back({pose * Vec3{along, 0, 0}, 0.02, 250});
            detections[c][m] =
                detect_wand(studio::draw_balls(studio.draw_empty(c, m + 1), cameras[c], balls, kNoiseGrey,
                                               static_cast<std::uint32_t>(31 * m + c)),
                            empty, wand);
        }
    });
    WandProcedure procedure(without_extrinsics(cameras), wand);
    for (std::size_t c = 0; c < cameras.size(); ++c)
        for (int m = 0; m < frame_sets; ++m)
            procedure.add_observation(m, static_cast<int>(c), detections[c][m]);
    return procedure.solve();
}

// Duration of the solve alone: 500 frame sets, each seen by about three of eight cameras.
bool measure_time() {
    studio::StudioOptions ring;
    ring.cameras = 8, ring.width = 1280, ring.height = 960;
    const std::vector<Camera> cameras = studio::ring_of_cameras(ring, false);
    const BoardSpec board = *parse_board("charuco:6x5:160:120:DICT_4X4_100");
    const std::vector<Vec3> points = board.points();
    ExtrinsicsOptions options;
    ExtrinsicsProcedure procedure(without_extrinsics(cameras), board, options);
    std::mt19937 random(3);
    std::normal_distribution<double> noise(0, 0.2);
    for (int m = 0; m < 500; ++m) {
        const Rigid3 pose = studio::held_board(cameras, kLower, kUpper, {0.48, 0.40, 0}, m, 5);
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            if ((pose.inverse() * cameras[c].centre_in_world()).z < 0.5) continue;
            BoardDetection detection;
            for (std::size_t p = 0; p < points.size(); ++p) {
                const auto seen = cameras[c].project(pose * points[p]);
                if (seen && seen->x > 0 && seen->y > 0 && seen->x < ring.width && seen->y < ring.height)
                    detection.corners.push_back(
                        {static_cast<int>(p), {seen->x + noise(random), seen->y + noise(random)}});
            }
            if (detection.corners.size() > 8) procedure.add_observation(m, static_cast<int>(c), detection);
        }
    }
    int reports = 0;
    const Stopwatch solving;
    const auto result = procedure.solve([&](double, const std::string&) { return ++reports > 0; });
    const double seconds = solving.seconds();
    if (!result.ok()) {
        fmt::print("time: {}\n", std::string(result.status().message()));
        return false;
    }
    int views = 0;
    for (const CameraReprojection& quality : result->reprojections) views += quality.views;
    fmt::print(
        "| time, 8 cameras, 500 frame sets, {} views in the fit | {:.1f} s | {} progress reports | {:.2f} mm "
        "|\n",
        views, seconds, reports, errors_against(cameras, result->cameras).centre_mm);
    return seconds < kMaxSeconds && reports > 5;
}

bool accuracy_of(const std::string& tool, int cameras, int frame_sets) {
    const auto studio = make_studio(cameras);
    if (!studio) return false;
    const auto result = tool == "board" ? by_board(*studio, frame_sets) : by_wand(*studio, frame_sets);
    if (!result.ok() || result->cameras.size() != static_cast<std::size_t>(cameras)) {
        fmt::print("| {}, {} cameras | {} |\n", tool, cameras,
                   result.ok() ? "some cameras were not connected" : std::string(result.status().message()));
        return false;
    }
    const Errors e = errors_against(studio->cameras(), result->cameras);
    fmt::print("| {}, {} cameras | {:.2f} mm | {:.4f} degrees | {:.3f} % | {:.2f} px |\n", tool, cameras,
               e.centre_mm, e.rotation_deg, 100 * e.scale_fraction,
               result->held_out_rms_px.value_or(std::nan("")));
    return e.centre_mm <= kMaxCentreMm && e.rotation_deg <= kMaxRotationDeg &&
           e.scale_fraction <= kMaxScaleFraction;
}

}  // namespace
}  // namespace kinevox

int main(int argc, char** argv) {
    const std::vector<std::string> wanted(argv + 1, argv + argc);
    const auto want = [&](const char* what) {
        return wanted.empty() || std::find(wanted.begin(), wanted.end(), what) != wanted.end();
    };
    fmt::print(
        "| what | centres, worst | rotations, worst | scale | held out |\n| --- | ---: | ---: | ---: | ---: "
        "|\n");
    std::fflush(stdout);
    bool good = true;
    for (const char* tool : {"board", "wand"})
        for (const int cameras : {4, 8})
            if (want(tool)) good = kinevox::accuracy_of(tool, cameras, 20 * cameras) && good;
    if (want("time")) good = kinevox::measure_time() && good;
    fmt::print("{}\n", good ? "within the bounds" : "FAILED");
    return good ? 0 : 1;
}
