#include "server/pose/capsule_balls.h"

#include <algorithm>

#include "kernels/outside_silhouette.h"

namespace kinevox {
namespace {

constexpr double kMinSeenDepth_m = 0.2;

kernels::PinholeView pinhole_view(const Camera& c) {
    kernels::PinholeView view;
    std::copy(c.camera_from_world.rotation.m.begin(), c.camera_from_world.rotation.m.end(), view.rotation);
    const Vec3& t = c.camera_from_world.translation;
    view.translation[0] = t.x, view.translation[1] = t.y, view.translation[2] = t.z;
    view.fx = c.fx, view.fy = c.fy, view.cx = c.cx, view.cy = c.cy;
    view.k1 = c.k1, view.k2 = c.k2, view.p1 = c.p1, view.p2 = c.p2, view.k3 = c.k3;
    view.width = c.width, view.height = c.height;
    return view;
}

}  // namespace

void CapsuleBalls::place(std::span<const BodyCapsule> capsules, std::span<const double> along) {
    const std::size_t count = capsules.size() * along.size();
    for (auto& values : placed_) values.resize(count);
    for (auto& values : measured_) values.resize(count);
    std::size_t n = 0;
    for (const BodyCapsule& c : capsules)
        for (const double t : along) {
            for (int axis = 0; axis < 3; ++axis) placed_[axis][n] = (1 - t) * c.a[axis] + t * c.b[axis];
            placed_[3][n++] = (1 - t) * c.radius_a + t * c.radius_b;
        }
}

void CapsuleBalls::measure(const SilhouetteRays& view) {
    kernels::measure_outside(pinhole_view(*view.camera), view.distance.map(),
                             {{placed_[0].data(), placed_[1].data(), placed_[2].data()},
                              placed_[3].data(),
                              static_cast<int>(size())},
                             kMinSeenDepth_m,
                             {measured_[0].data(),
                              {measured_[1].data(), measured_[2].data(), measured_[3].data()},
                              {measured_[4].data(), measured_[5].data()},
                              {measured_[6].data(), measured_[7].data()}});
}

}  // namespace kinevox
