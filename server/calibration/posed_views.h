// Views of a board with the board's pose before each camera, and what pairs of cameras conclude from them.
#pragma once

#include <map>
#include <vector>

#include "server/calibration/board_pose.h"
#include "server/calibration/camera_tree.h"

namespace kinevox {

struct PosedView {
    int camera = 0;
    std::vector<Corner> corners;
    BoardPose pose;
};

class PosedViews {
  public:
    PosedViews(std::vector<Camera> lenses, std::vector<Vec3> points);

    // Left out where no pose fits.
    void add(int moment, int camera, const std::vector<Corner>& corners);
    // Leaves at most `most` moments that two or more cameras saw, evenly.
    void thin(int most);
    void drop_misfits(double max_rms_px);

    std::vector<int> moments() const;
    // A moment's views by the cameras that `new_index` keeps (>= 0), with their new indices.
    std::vector<PosedView> at(int moment, const std::vector<int>& new_index) const;
    const std::map<int, std::vector<PosedView>>& all() const { return views_; }

    // Per pair of cameras with moments in common, the relative place on which most of these agree.
    std::vector<CameraPair> pairs() const;
    const std::vector<Camera>& lenses() const { return lenses_; }
    const std::vector<Vec3>& points() const { return points_; }

  private:
    std::vector<Camera> lenses_;
    std::vector<Vec3> points_;
    std::map<int, std::vector<PosedView>> views_;
};

// Root mean square error of a view under a pose of the board, px; 1e6 behind the camera.
double view_error_px(const Camera& lens, const Rigid3& camera_from_board, const std::vector<Corner>& corners,
                     const std::vector<Vec3>& points);

// Of the poses that the views propose, the one that fits all of them best. Cameras by the views' indices,
// placed.
Rigid3 best_world_from_board(const std::vector<Camera>& cameras, const std::vector<PosedView>& views,
                             const std::vector<Vec3>& points);

}  // namespace kinevox
