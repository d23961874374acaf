// What each camera of a session sees move, by itself: nothing here knows which pictures belong together.
#pragma once

#include <absl/status/statusor.h>

#include <functional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "common/session_file.h"

namespace kinevox::sync {

// The silhouette in one picture; all in px of the camera's full picture.
struct SeenShape {
    bool seen = false;  // somebody is there; nothing below has a meaning without
    bool cut_above = false, cut_below = false, cut_aside = false;  // by the picture's border
    double area_px2 = 0;
    double top_px = 0, bottom_px = 0;  // y of its ends
    double centroid_x_px = 0, centroid_y_px = 0;
    double changed_px2 = 0;            // differs from the picture before; NaN where nobody was seen there
    std::vector<Vec2> hull;            // convex, around it
    std::vector<bool> hull_at_border;  // there the picture ends, the subject may not
};

struct CameraMotion {
    Camera camera;                  // as its calibration has it
    std::vector<SeenShape> shapes;  // one a picture of the video
};

struct CameraMotionOptions {
    // Pictures are made smaller by a whole factor until their longer side is at most this, px. 0: never.
    int max_side_px = 960;
};

// How far it is, 0 to 1, and what it does; false cancels. May come from several threads, one at a time.
using Progress = std::function<bool(double part, const std::string& what)>;

// All videos from their first to their last picture, whatever their lengths; offsets in the session count for
// nothing. Every camera needs a background. Errors name camera and file; Cancelled by `progress`.
absl::StatusOr<std::vector<CameraMotion>> read_motion(const Session& session,
                                                      const CameraMotionOptions& options = {},
                                                      const Progress& progress = {});

}  // namespace kinevox::sync
