#include "tests/support/seen_body.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include "common/geometry.h"
#include "server/pose/ray_capsule.h"

namespace kinevox::testing {
namespace {

constexpr int kWidth = 320, kHeight = 240;

// Removes capsules below a height, and shortens those that cross it.
void cut_below(double z_m, std::vector<BodyCapsule>& capsules) {
    std::erase_if(capsules, [z_m](const BodyCapsule& c) { return std::max(c.a[2], c.b[2]) < z_m; });
    for (BodyCapsule& c : capsules) {
        const auto z = static_cast<float>(z_m);
        float* const below = c.a[2] < z ? c.a : c.b[2] < z ? c.b : nullptr;
        if (!below) continue;
        const float* const above = below == c.a ? c.b : c.a;
        const float share = (z - below[2]) / (above[2] - below[2]);
        for (int k = 0; k < 3; ++k) below[k] += share * (above[k] - below[k]);
    }
}

// The pixels outside cannot see a capsule; most of an image.
kernels::Rect box_around(const Camera& camera, const std::vector<BodyCapsule>& capsules) {
    const kernels::Rect whole{0, 0, camera.width, camera.height};
    for (const double distortion : {camera.k1, camera.k2, camera.p1, camera.p2, camera.k3})
        if (distortion != 0) return whole;
    kernels::Rect box{camera.width, camera.height, 0, 0};
    for (const BodyCapsule& c : capsules)
        for (int corner = 0; corner < 8; ++corner) {
            double at[3];
            for (int k = 0; k < 3; ++k)
                at[k] = corner >> k & 1 ? std::max(c.a[k] + c.radius_a, c.b[k] + c.radius_b)
                                        : std::min(c.a[k] - c.radius_a, c.b[k] - c.radius_b);
            const auto pixel = camera.project({at[0], at[1], at[2]});
            if (!pixel) return whole;
            const auto limited = [](double value, int size) {
                return static_cast<int>(std::clamp(value, 0.0, static_cast<double>(size)));
            };
            box.x0 = std::min(box.x0, limited(std::floor(pixel->x) - 1, camera.width));
            box.y0 = std::min(box.y0, limited(std::floor(pixel->y) - 1, camera.height));
            box.x1 = std::max(box.x1, limited(std::ceil(pixel->x) + 2, camera.width));
            box.y1 = std::max(box.y1, limited(std::ceil(pixel->y) + 2, camera.height));
        }
    return box;
}

}  // namespace

std::vector<Camera> camera_ring(int count) {
    std::vector<Camera> cameras;
    for (int k = 0; k < count; ++k) {
        const double turn = 2 * std::numbers::pi * (k + 0.3) / count;
        const Vec3 centre{4 * std::cos(turn), 4 * std::sin(turn), 1.6}, target{0, 0, 0.9};
        const Vec3 forward = normalized(target - centre), right = normalized(cross(forward, {0, 0, 1})),
                   down = cross(forward, right);
        Camera camera;
        camera.name = "cam" + std::to_string(k);
        camera.width = kWidth, camera.height = kHeight;
        camera.fx = camera.fy = 330;
        camera.cx = (kWidth - 1) / 2.0, camera.cy = (kHeight - 1) / 2.0;
        camera.camera_from_world.rotation = {
            {right.x, right.y, right.z, down.x, down.y, down.z, forward.x, forward.y, forward.z}};
        camera.camera_from_world.translation = -(camera.camera_from_world.rotation * centre);
        cameras.push_back(camera);
    }
    return cameras;
}

kernels::Silhouettes silhouette_of(const Camera& camera, const std::vector<BodyCapsule>& capsules) {
    kernels::Silhouettes s;
    s.width = camera.width, s.height = camera.height;
    s.sharp.assign(static_cast<std::size_t>(camera.width) * camera.height, 0);
    s.bounds = {camera.width, camera.height, 0, 0};
    ContourRays rays;
    rays.origin_in_world = camera.centre_in_world();
    const kernels::Rect box = box_around(camera, capsules);
    for (int y = box.y0; y < box.y1; ++y)
        for (int x = box.x0; x < box.x1; ++x) {
            const Vec3 d =
                camera.ray_through({static_cast<double>(x), static_cast<double>(y)}).direction_in_world;
            const float direction[3] = {static_cast<float>(d.x), static_cast<float>(d.y),
                                        static_cast<float>(d.z)};
            for (int axis = 0; axis < 3; ++axis) {
                rays.direction[axis].push_back(direction[axis]);
                rays.outward[axis].push_back(0);
            }
        }
    std::vector<float> distance;
    std::vector<int> which;
    nearest_capsules(rays, capsules, distance, which);
    std::size_t ray = 0;
    for (int y = box.y0; y < box.y1; ++y)
        for (int x = box.x0; x < box.x1; ++x) {
            if (!(distance[ray++] < 0)) continue;
            s.sharp[static_cast<std::size_t>(y) * camera.width + x] = 255;
            ++s.sharp_pixels;
            s.bounds = {std::min(s.bounds.x0, x), std::min(s.bounds.y0, y), std::max(s.bounds.x1, x + 1),
                        std::max(s.bounds.y1, y + 1)};
        }
    if (s.sharp_pixels == 0) s.bounds = {};
    return s;
}

BodyCoordinates SeenBody::standing() const {
    BodyCoordinates q{};
    q[2] = 0.96;
    q[5] = radians(25);
    q[kSegmentDof[kThorax]] = radians(-13);
    q[kDofShoulderL + 1] = radians(-50), q[kDofShoulderR] = radians(40), q[kDofElbowR] = radians(60),
                      q[kDofElbowL] = radians(20);
    q[kDofHipL] = radians(25), q[kDofKneeL] = radians(35), q[kDofHipR] = radians(-5),
    q[kDofKneeR] = radians(10);
    return q;
}

BodyCoordinates SeenBody::t_pose() const {
    BodyCoordinates q{};
    q[2] = 0.98;
    q[kSegmentDof[kThorax]] = radians(-11);
    q[kDofShoulderL + 1] = q[kDofShoulderR + 1] = radians(-88);
    q[kDofHipL + 1] = q[kDofHipR + 1] = radians(-8);
    return q;
}

std::vector<SilhouetteRays> SeenBody::see(const BodyPosture& posture) const {
    std::vector<BodyCapsule> capsules;
    model->capsules(model->forward(posture), capsules);
    cut_below(hidden_below_m, capsules);
    std::vector<SilhouetteRays> views(cameras.size());
    for (std::size_t c = 0; c < cameras.size(); ++c)
        read_silhouette(cameras[c], silhouette_of(cameras[c], capsules), {}, views[c]);
    return views;
}

double SeenBody::error_m(const BodyPosture& posture, const BodyCoordinates& truth) const {
    const PosedBody a = model->forward(posture), b = model->forward(truth);
    double sum = 0;
    for (std::size_t j = 0; j < kJointNames.size(); ++j)
        sum += norm(a.joints_in_world[j] - b.joints_in_world[j]);
    return sum / kJointNames.size();
}

}  // namespace kinevox::testing
