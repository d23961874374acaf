// All cameras' places from a wand with two or three balls or lights in a row, waved through the space; scale
// from the wand.
#pragma once

#include <absl/status/statusor.h>

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "server/calibration/extrinsics.h"
#include "server/calibration/wand_pairs.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

struct WandSpec {
    // m from the first ball to the second and to the third; the second nearer to the first, by a third at
    // least, so that pictures tell the ends apart. 0: two balls only, which nothing but their movement tells
    // apart.
    double middle_m = 0.2, length_m = 0.6;
    // Empty when usable, else one sentence.
    std::string check() const;
    // Two or three, m along x from the first one.
    std::vector<Vec3> balls() const;
};

// "wand:200:600": mm from the first ball to the second and to the third; "wand:600": two balls.
absl::StatusOr<WandSpec> parse_wand(std::string_view text);

// px, from the first ball to the last; of two alike balls in either order.
using WandSighting = std::optional<std::vector<Vec2>>;

struct WandDetectorOptions {
    int min_difference = 40;  // grey levels against the empty scene
    double min_radius_px = 1.2, max_radius_px = 40;
};

// The bright spots that are not in the empty scene: three in a row, or just two; nothing where they cannot be
// told.
WandSighting find_wand(const Picture& picture, const Picture& empty_scene, const WandSpec& wand,
                       const WandDetectorOptions& options = {});

// The part of the picture, 0 to 1, that is clearly not as in the empty scene.
double changed_part(const Picture& picture, const Picture& empty_scene,
                    const WandDetectorOptions& options = {});

// Where a camera's picture has changed for good, by changed_part() of its pictures in their order: the first
// of these; -1: nowhere. A camera that was moved sees another scene.
int changed_for_good(const std::vector<double>& changed);

// Not thread safe. As ExtrinsicsProcedure.
class WandProcedure {
  public:
    WandProcedure(std::vector<Camera> lenses, const WandSpec& wand, const ExtrinsicsOptions& options = {});

    void add_observation(int moment, int camera, const WandSighting& sighting);
    std::vector<std::string> hints() const;
    absl::StatusOr<ExtrinsicsResult> solve(const SolveProgress& progress = {}) const;

  private:
    std::vector<Camera> lenses_;
    WandSpec wand_;
    ExtrinsicsOptions options_;
    WandMoments moments_;
};

}  // namespace kinevox
