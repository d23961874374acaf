// How far balls project beyond the border of a silhouette. An inner loop of fitting a pose.
#pragma once

namespace kinevox::kernels {

// A camera as common/camera.h has it.
struct PinholeView {
    double rotation[9] = {}, translation[3] = {};  // camera_from_world, by rows; m
    double fx = 0, fy = 0, cx = 0, cy = 0;         // px
    double k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;
    int width = 0, height = 0;  // px
};

// Distances in px to a silhouette's border, positive inside, at the centres of cells of `cell` x `cell` px;
// the first begins at the pixel (x0, y0). Bilinear between the centres; beyond them less the distance to
// them.
struct DistanceMapView {
    const float* distance = nullptr;  // rows of `columns`; null: no silhouette
    int columns = 0, rows = 0, cell = 1, x0 = 0, y0 = 0;
};

// Balls in the world, m; arrays of `count`.
struct BallList {
    const double* centre[3] = {};  // x, y, z
    const double* radius = nullptr;
    int count = 0;
};

// Arrays of as many.
struct OutsideList {
    double* outside_m = nullptr;  // at the depth of the centre; 0 where the camera sees nothing, see below
    double* in_camera[3] = {};    // m, the centre
    double* slope[2] = {};        // of the distance to the border, px per px to the right and down
    double* pixel[2] = {};        // of the centre, px
};

// The radius less the distance to the border. Nothing is known of a centre less than min_depth_m before the
// camera or outside the image.
void measure_outside(const PinholeView& camera, const DistanceMapView& map, const BallList& balls,
                     double min_depth_m, const OutsideList& out);

}  // namespace kinevox::kernels
