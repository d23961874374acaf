// Extrinsics of all cameras from a moving wand with two or three collinear balls or lights; the wand defines
// the scale.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "server/calibration/board/extrinsics.h"
#include "server/calibration/wand/wand_pairs.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

struct WandSpec {
    // m from the first ball to the second and to the third. The second is clearly closer to the first, so
    // that images distinguish the ends. 0: two balls, which only their motion distinguishes.
    double middle_m = 0.2, length_m = 0.6;
    // Empty if usable, else one sentence.
    std::string check() const;
    // Two or three, m along x from the first one.
    std::vector<Vec3> balls() const;
};

// "wand:200:600": mm from the first ball to the second and to the third; "wand:600": two balls.
absl::StatusOr<WandSpec> parse_wand(std::string_view text);

// px, from the first ball to the last; for two equal balls in either order.
using WandDetection = std::optional<std::vector<Vec2>>;

struct WandDetectorOptions {
    int min_difference = 40;  // grey levels against the background
    double min_radius_px = 1.2, max_radius_px = 40;
};

// Bright spots that are not in the background: three in a row, or exactly two; empty if ambiguous.
WandDetection detect_wand(const Image& image, const Image& empty_scene, const WandSpec& wand,
                          const WandDetectorOptions& options = {});

// Fraction of the image, 0 to 1, that clearly differs from the background.
double changed_fraction(const Image& image, const Image& empty_scene,
                        const WandDetectorOptions& options = {});

// Index of the first image after which the scene differs permanently, from changed_fraction() of the images
// in order; -1: none. It shows that the camera was moved.
int first_permanent_change(const std::vector<double>& changed);

// Not thread safe. Same interface as ExtrinsicsProcedure.
class WandProcedure {
  public:
    WandProcedure(std::vector<Camera> intrinsics, const WandSpec& wand,
                  const ExtrinsicsOptions& options = {});

    void add_observation(int frame_set, int camera, const WandDetection& detection);
    std::vector<std::string> hints() const;
    absl::StatusOr<ExtrinsicsResult> solve(const SolveProgress& progress = {}) const;

  private:
    std::vector<Camera> intrinsics_;
    WandSpec wand_;
    ExtrinsicsOptions options_;
    WandFrameSets frame_sets_;
};

}  // namespace kinevox
