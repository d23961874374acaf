// All cameras' places from a wand with three balls or lights in a row, waved through the space; scale from
// the wand.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "server/calibration/camera_tree.h"
#include "server/calibration/extrinsics.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

struct WandSpec {
    // m from the first ball to the second and to the third; the second nearer to the first, by a third at
    // least, so that pictures tell the ends apart.
    double middle_m = 0.2, length_m = 0.6;
    // Empty when usable, else one sentence.
    std::string check() const;
};

// "wand:200:600": mm from the first ball to the second and to the third.
absl::StatusOr<WandSpec> parse_wand(std::string_view text);

using WandSighting = std::optional<std::array<Vec2, 3>>;  // px, from the first ball to the third

struct WandDetectorOptions {
    int least_difference = 40;  // grey levels against the empty scene
    double least_radius_px = 1.2, most_radius_px = 40;
};

// The three bright spots in a row that are not in the empty scene; nothing where they cannot be told.
WandSighting find_wand(const Picture& picture, const Picture& empty_scene, const WandSpec& wand,
                       const WandDetectorOptions& options = {});

// Not thread safe. As ExtrinsicsProcedure.
class WandProcedure {
  public:
    WandProcedure(std::vector<Camera> lenses, const WandSpec& wand, const ExtrinsicsOptions& options = {});

    void add_observation(int moment, int camera, const WandSighting& sighting);
    std::vector<std::string> hints() const;
    absl::StatusOr<ExtrinsicsResult> solve(const SolveProgress& progress = {}) const;

  private:
    std::vector<CameraPair> pairs() const;
    std::vector<Camera> lenses_;
    WandSpec wand_;
    ExtrinsicsOptions options_;
    std::map<int, std::map<int, std::array<Vec2, 3>>> moments_;  // [moment][camera]
};

}  // namespace kinevox
