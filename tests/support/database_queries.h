// Frame sets of a posed body for the pose database's tests and benchmarks: rendered into calibrated cameras.
#pragma once

#include <span>
#include <vector>

#include "kernels/segmentation.h"
#include "server/pose/body_model.h"
#include "server/pose/pose_candidate.h"

namespace kinevox {

struct RenderedFrame {
    std::vector<kernels::Silhouettes> silhouettes;  // per camera; `sharp` and what belongs to it
    Vec3 centre_in_world;                           // of the body's volume
    std::vector<PoseView> views(std::span<const kernels::CameraModel> cameras) const;
};

RenderedFrame render_frame(const BodyModel& model, const BodyCoordinates& pose,
                           std::span<const kernels::CameraModel> cameras);

// Poses that a database does not hold: blends of its key poses that it never makes, every joint a little off.
// The number decides which one.
BodyCoordinates unseen_pose(int number, double noise_deg = 4);

// Mean distance of all joints, m.
double mean_joint_distance(const BodyModel& model, const BodyCoordinates& a, const BodyCoordinates& b);

// Four cameras of 640 x 480 px in the corners of a room of 8 m x 8 m, 2.4 m high, looking at its middle.
std::vector<kernels::CameraModel> room_cameras();
// Six cameras beside and at the ends of a lane from x = 0 to 12, y = -1 to 1.
std::vector<kernels::CameraModel> lane_cameras();

}  // namespace kinevox
