#include "tests/support/database_queries.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <random>

#include "kernels/body_silhouette.h"
#include "server/pose/database/pose_database.h"
#include "server/pose/database/pose_library.h"

namespace kinevox {
namespace {

kernels::CameraModel looking(Vec3 from, Vec3 at, double focal_px) {
    kernels::CameraModel camera;
    camera.width = 640, camera.height = 480;
    camera.fx = camera.fy = static_cast<float>(focal_px);
    camera.cx = 319.5f, camera.cy = 239.5f;
    const Vec3 z = normalized(at - from), x = normalized(cross(z, Vec3{0, 0, 1})), y = cross(z, x);
    const Vec3 rows[3] = {x, y, z};
    for (int r = 0; r < 3; ++r) {
        camera.rotation_camera_from_world[3 * r] = static_cast<float>(rows[r].x);
        camera.rotation_camera_from_world[3 * r + 1] = static_cast<float>(rows[r].y);
        camera.rotation_camera_from_world[3 * r + 2] = static_cast<float>(rows[r].z);
        camera.translation_camera_from_world[r] = static_cast<float>(-dot(rows[r], from));
    }
    return camera;
}

}  // namespace

std::vector<PoseView> RenderedFrame::views(std::span<const kernels::CameraModel> cameras) const {
    std::vector<PoseView> out;
    for (std::size_t n = 0; n < cameras.size(); ++n) out.push_back({&cameras[n], &silhouettes[n]});
    return out;
}

RenderedFrame render_frame(const BodyModel& model, const BodyCoordinates& pose,
                           std::span<const kernels::CameraModel> cameras) {
    RenderedFrame frame;
    std::vector<BodyCapsule> capsules;
    model.capsules(model.forward(pose), capsules);
    std::vector<kernels::TaperedCapsule> body;
    for (const BodyCapsule& c : capsules)
        body.push_back({{c.a[0], c.a[1], c.a[2]}, {c.b[0], c.b[1], c.b[2]}, c.radius_a, c.radius_b});
    frame.centre_in_world = body_centre(capsules);
    auto renderer = kernels::make_body_silhouette_renderer(kernels::Device::kCpu);
    for (const kernels::CameraModel& camera : cameras) {
        kernels::Silhouettes& out = frame.silhouettes.emplace_back();
        out.width = camera.width, out.height = camera.height;
        out.sharp.resize(static_cast<std::size_t>(camera.width) * camera.height);
        kernels::BodyView view{&camera, out.sharp.data(), {}};
        renderer->render(body, std::span(&view, 1));
        out.bounds = view.bounds;
        out.loose = out.sharp;
        out.sharp_pixels = std::count(out.sharp.begin(), out.sharp.end(), 255);
    }
    return frame;
}

BodyCoordinates unseen_pose(int number, double noise_deg) {
    std::mt19937 random(static_cast<unsigned>(9001 + number));
    static const std::vector<LibraryPose> keys = library_poses(key_pose_count());
    const auto& a = keys[random() % keys.size()];
    const auto& b = keys[random() % keys.size()];
    BodyCoordinates q = blended(a.coordinates, b.coordinates, 0.1 + 0.25 * (random() % 1000) / 1000.0);
    for (int dof = kDofRootRotation; dof < kBodyDofCount; ++dof) {
        if (dof == kDofRootRotation + 2) continue;
        q[dof] +=
            noise_deg * std::numbers::pi / 180 * (static_cast<double>(random() % 2001) / 1000 - 1) * 1.7;
        q[dof] = std::clamp(q[dof], kBodyDofs[dof].lower, kBodyDofs[dof].upper);
    }
    return q;
}

double mean_joint_distance(const BodyModel& model, const BodyCoordinates& a, const BodyCoordinates& b) {
    const auto ja = model.forward(a).joints_in_world, jb = model.forward(b).joints_in_world;
    double sum = 0;
    for (std::size_t n = 0; n < ja.size(); ++n) sum += norm(ja[n] - jb[n]);
    return sum / static_cast<double>(ja.size());
}

std::vector<kernels::CameraModel> room_cameras() {
    std::vector<kernels::CameraModel> cameras;
    for (const auto& [x, y] : {std::pair{3.9, 3.6}, {-3.8, 3.9}, {-4.0, -3.7}, {3.7, -4.0}})
        cameras.push_back(looking({x, y, 2.4}, {0, 0, 0.9}, 620));
    return cameras;
}

std::vector<kernels::CameraModel> lane_cameras() {
    std::vector<kernels::CameraModel> cameras;
    for (const double x : {1.0, 6.0, 11.0})
        for (const double side : {-1.0, 1.0})
            cameras.push_back(
                looking({x + 0.7 * side, 6.5 * side, 2.2}, {x == 6 ? 6 : (x < 6 ? 4.5 : 7.5), 0, 0.9}, 330));
    return cameras;
}

}  // namespace kinevox
