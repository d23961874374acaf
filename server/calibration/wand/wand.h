// Extrinsics of all cameras from a moving wand with two or three collinear balls or lights; the wand defines
// the scale.
#pragma once

#include <absl/status/statusor.h>

#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board/board_clips.h"
#include "server/calibration/board/extrinsics.h"
#include "server/calibration/multi_view.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

// Relative camera poses from a wand that both cameras detect, and the order of two equal balls; in
// wand_pairs.cc.

// [frame set][camera]: px, one per ball, from the first to the last.
using WandFrameSets = std::map<int, std::map<int, std::vector<Vec2>>>;

inline constexpr int kMinWandFrameSets = 12;  // shared by a pair of cameras

// Per pair of cameras with enough shared frame sets, their relative pose from the essential matrix; the scale
// comes from `balls` (m along the wand). Two equal balls are distinguished by their motion, which needs
// consecutive frame sets.
std::vector<CameraPair> wand_pairs(const std::vector<Camera>& intrinsics, const std::vector<Vec3>& balls,
                                   const WandFrameSets& frame_sets);

// Orders the two balls of each frame set so that the posed cameras are most consistent. Removes views of
// cameras with `has_pose` false, and frame sets that fewer than two of the others share.
void order_two_balls(const std::vector<Camera>& cameras, const std::vector<bool>& has_pose, double length_m,
                     WandFrameSets& frame_sets);

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

// The wand detected in videos, one per camera; in wand_clips.cc.

// Cameras in parallel: detections[camera][image]. The background is the clip's background, or the median of
// some of its own images. Cancelled by `progress`.
struct WandImage {
    WandDetection wand;
    double changed = 0;  // see changed_fraction()
};
absl::StatusOr<std::vector<std::vector<WandImage>>> detect_wands(const std::vector<CameraClip>& clips,
                                                                 const WandSpec& wand,
                                                                 const ClipImages& which,
                                                                 const SolveProgress& progress);

}  // namespace kinevox
