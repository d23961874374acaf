// The board's pose relative to each camera that views it, and the relative camera poses that follow.
#pragma once

#include <map>
#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/calibration/board/board_detector.h"
#include "server/calibration/multi_view.h"

namespace kinevox {

// Pose of a board relative to a camera with known intrinsics.
struct BoardPose {
    Rigid3 camera_from_board;
    double rms_px = 0;
    // Ratio of the error of the second planar solution to this one's; near 1 the pose is ambiguous.
    double ambiguity_ratio = 1;
    // Angle between the print's normal and the direction to the camera, radians; above pi / 2 the print is
    // seen from behind.
    double tilt_rad = 0;
};

// Empty for fewer than four corners or without a valid pose. `points` by id, in the board frame.
std::optional<BoardPose> board_pose(const Camera& camera, const std::vector<Corner>& corners,
                                    const std::vector<Vec3>& points);

struct PosedView {
    int camera = 0;
    std::vector<Corner> corners;
    BoardPose pose;
};

class PosedViews {
  public:
    PosedViews(std::vector<Camera> intrinsics, std::vector<Vec3> points);

    // Ignored if no pose fits.
    void add(int frame_set, int camera, const std::vector<Corner>& corners);
    // Keeps at most `most` frame sets that two or more cameras share, evenly.
    void thin(int most);
    void drop_misfits(double max_rms_px);

    std::vector<int> frame_sets() const;
    // Views of a frame set by the cameras with new_index >= 0, with their new indices.
    std::vector<PosedView> at(int frame_set, const std::vector<int>& new_index) const;
    const std::map<int, std::vector<PosedView>>& all() const { return views_; }

    // Per pair of cameras with shared frame sets, the relative pose with the most inliers.
    std::vector<CameraPair> pairs() const;
    const std::vector<Camera>& intrinsics() const { return intrinsics_; }
    const std::vector<Vec3>& points() const { return points_; }

  private:
    std::vector<Camera> intrinsics_;
    std::vector<Vec3> points_;
    std::map<int, std::vector<PosedView>> views_;
};

// Root mean square reprojection error of a view for a board pose, px; 1e6 behind the camera.
double view_error_px(const Camera& intrinsics, const Rigid3& camera_from_board,
                     const std::vector<Corner>& corners, const std::vector<Vec3>& points);

// The best of the poses that the views propose. `cameras` by the views' indices, with poses.
Rigid3 best_world_from_board(const std::vector<Camera>& cameras, const std::vector<PosedView>& views,
                             const std::vector<Vec3>& points);

}  // namespace kinevox
