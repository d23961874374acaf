// Motion of the silhouette in each camera of a session, independent of the other cameras.
#pragma once

#include <absl/status/statusor.h>

#include <functional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "common/session_file.h"

namespace kinevox::sync {

// The silhouette in one image; all in px of the full image.
struct SilhouetteShape {
    bool seen = false;  // a person is visible; the members below are undefined otherwise
    bool truncated_top = false, truncated_bottom = false, truncated_sides = false;  // by the image border
    double area_px2 = 0;
    double top_px = 0, bottom_px = 0;  // y of its ends
    double centroid_x_px = 0, centroid_y_px = 0;
    double changed_px2 = 0;            // differs from the previous image; NaN if that has no person
    std::vector<Vec2> hull;            // convex
    std::vector<bool> hull_at_border;  // the image ends there, the subject may not
};

struct CameraMotion {
    Camera camera;                        // from the calibration
    std::vector<SilhouetteShape> shapes;  // one per image of the video
};

struct CameraMotionOptions {
    // Images are reduced by an integer factor until their longer side is at most this, px. 0: never.
    int max_side_px = 960;
};

// Called with the progress (0 to 1) and the current step; false cancels. Serialised, from several threads.
using Progress = std::function<bool(double progress, const std::string& what)>;

// Reads all videos completely; offsets in the session are ignored. Every camera needs a background. Errors
// name camera and file; Cancelled by `progress`.
absl::StatusOr<std::vector<CameraMotion>> read_motion(const Session& session,
                                                      const CameraMotionOptions& options = {},
                                                      const Progress& progress = {});

}  // namespace kinevox::sync
