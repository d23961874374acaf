#include "server/pipeline/tracking/cone_box.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace kinevox {
namespace {

// Points with dot(normal, x) >= offset are inside.
struct HalfSpace {
    Vec3 normal;
    double offset = 0;
    double height(Vec3 x) const { return dot(normal, x) - offset; }
};

using Polygon = std::vector<Vec3>;
using Polytope = std::vector<Polygon>;  // its faces; orientation does not matter here

Polytope polytope_of(const Box3& b) {
    const auto corner = [&](int n) {
        return Vec3{n & 1 ? b.max_in_world.x : b.min_in_world.x, n & 2 ? b.max_in_world.y : b.min_in_world.y,
                    n & 4 ? b.max_in_world.z : b.min_in_world.z};
    };
    static constexpr int kFaces[6][4] = {{0, 1, 3, 2}, {4, 5, 7, 6}, {0, 1, 5, 4},
                                         {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 3, 7, 5}};
    Polytope faces;
    for (const auto& face : kFaces)
        faces.push_back({corner(face[0]), corner(face[1]), corner(face[2]), corner(face[3])});
    return faces;
}

// Sorts the points of the cut, a convex polygon in the plane, around their centre.
void sort_around(Polygon& points, Vec3 normal) {
    Vec3 middle;
    for (const Vec3& p : points) middle += p;
    middle = middle / static_cast<double>(points.size());
    const Vec3 axis = std::abs(normal.z) < 0.9 ? Vec3{0, 0, 1} : Vec3{1, 0, 0};
    const Vec3 u = normalized(cross(normal, axis)), v = cross(normal, u);
    std::vector<std::pair<double, Vec3>> by_angle;
    for (const Vec3& p : points) by_angle.emplace_back(std::atan2(dot(p - middle, v), dot(p - middle, u)), p);
    std::stable_sort(by_angle.begin(), by_angle.end(),
                     [](const auto& a, const auto& b) { return a.first < b.first; });
    for (std::size_t n = 0; n < points.size(); ++n) points[n] = by_angle[n].second;
}

void clip(Polytope& polytope, const HalfSpace& half) {
    Polytope kept;
    Polygon cut;
    for (const Polygon& face : polytope) {
        Polygon clipped;
        for (std::size_t n = 0; n < face.size(); ++n) {
            const Vec3 a = face[n], b = face[(n + 1) % face.size()];
            const double ha = half.height(a), hb = half.height(b);
            if (ha >= 0) clipped.push_back(a);
            if ((ha >= 0) != (hb >= 0)) {
                const Vec3 crossing = a + (ha / (ha - hb)) * (b - a);
                clipped.push_back(crossing);
                cut.push_back(crossing);
            }
        }
        if (clipped.size() >= 3) kept.push_back(std::move(clipped));
    }
    if (cut.size() >= 3) {
        sort_around(cut, normalized(half.normal));
        kept.push_back(std::move(cut));
    }
    polytope = std::move(kept);
}

// The pyramid's sides, through the camera's centre. Distortion bends the box's sides: the outermost of
// several points of each side is used.
void add_pyramid(const SilhouetteCone& cone, std::vector<HalfSpace>& halves) {
    constexpr int kSamples = 8;
    constexpr double kMargin_px = 1.0;
    const Camera& camera = *cone.camera;
    const bool cut_left = cone.bounds.x0 <= 0, cut_right = cone.bounds.x1 >= camera.width;
    const bool cut_above = cone.bounds.y0 <= 0, cut_below = cone.bounds.y1 >= camera.height;
    const double widened_px = cut_above || cut_below ? 0.5 * cone.bounds.width() : 0;
    const double u0 = cone.bounds.x0 - 0.5 - kMargin_px - widened_px,
                 u1 = cone.bounds.x1 - 0.5 + kMargin_px + widened_px;
    const double v0 = cone.bounds.y0 - 0.5 - kMargin_px, v1 = cone.bounds.y1 - 0.5 + kMargin_px;
    const Vec3 centre = camera.centre_in_world();
    const Mat3 world_from_camera = camera.camera_from_world.rotation.transposed();
    const auto side = [&](Vec2 from, Vec2 to, bool horizontal, double sign) {
        double outermost = std::numeric_limits<double>::infinity();
        for (int n = 0; n <= kSamples; ++n) {
            const double t = static_cast<double>(n) / kSamples;
            const Ray ray = camera.ray_through({from.x + t * (to.x - from.x), from.y + t * (to.y - from.y)});
            const Vec3 d = camera.camera_from_world.rotation * ray.direction_in_world;
            outermost = std::min(outermost, sign * (horizontal ? d.x : d.y) / d.z);
        }
        // sign * x / z >= outermost
        const Vec3 normal_in_camera = horizontal ? Vec3{sign, 0, -outermost} : Vec3{0, sign, -outermost};
        const Vec3 normal = world_from_camera * normal_in_camera;
        halves.push_back({normal, dot(normal, centre)});
    };
    const bool cut_aside = cut_left || cut_right;
    if (!cut_left) side({u0, v0}, {u0, v1}, true, 1);
    if (!cut_right) side({u1, v0}, {u1, v1}, true, -1);
    if (!cut_above && !cut_aside) side({u0, v0}, {u1, v0}, false, 1);
    if (!cut_below && !cut_aside) side({u0, v1}, {u1, v1}, false, -1);
    const Vec3 forward = world_from_camera * Vec3{0, 0, 1};
    halves.push_back({forward, dot(forward, centre)});
}

}  // namespace

std::optional<Box3> box_of_cones(const std::vector<SilhouetteCone>& cones, const Box3& within) {
    std::vector<HalfSpace> halves;
    for (const SilhouetteCone& cone : cones) add_pyramid(cone, halves);
    Polytope polytope = polytope_of(within);
    for (const HalfSpace& half : halves) clip(polytope, half);
    if (polytope.empty()) return std::nullopt;
    Box3 box{polytope[0][0], polytope[0][0]};
    for (const Polygon& face : polytope)
        for (const Vec3& p : face) {
            box.min_in_world = {std::min(box.min_in_world.x, p.x), std::min(box.min_in_world.y, p.y),
                                std::min(box.min_in_world.z, p.z)};
            box.max_in_world = {std::max(box.max_in_world.x, p.x), std::max(box.max_in_world.y, p.y),
                                std::max(box.max_in_world.z, p.z)};
        }
    return box;
}

kernels::Lattice lattice_over(const Box3& box, double voxel_m, double max_side_m, Vec3 centre) {
    const double brick_m = kernels::kBrickEdge * voxel_m;
    const std::array<double, 3> low{box.min_in_world.x, box.min_in_world.y, box.min_in_world.z};
    const std::array<double, 3> high{box.max_in_world.x, box.max_in_world.y, box.max_in_world.z};
    const std::array<double, 3> middle{centre.x, centre.y, centre.z};
    kernels::Lattice lattice;
    lattice.voxel_m = static_cast<float>(voxel_m);
    for (int axis = 0; axis < 3; ++axis) {
        double a = low[axis], b = high[axis];
        if (b - a > max_side_m) {
            a = std::clamp(middle[axis] - max_side_m / 2, a, b - max_side_m);
            b = a + max_side_m;
        }
        const double first = std::floor(a / brick_m), last = std::max(std::ceil(b / brick_m), first + 1);
        lattice.origin[axis] = static_cast<float>(first * brick_m);
        lattice.size[axis] = static_cast<int>(last - first) * kernels::kBrickEdge;
    }
    return lattice;
}

Box3 box_of(const kernels::Lattice& lattice) {
    const auto corner = [&](bool end) {
        const auto along = [&](int axis) {
            return static_cast<double>(lattice.origin[axis]) +
                   (end ? static_cast<double>(lattice.voxel_m) * lattice.size[axis] : 0.0);
        };
        return Vec3{along(0), along(1), along(2)};
    };
    return {corner(false), corner(true)};
}

kernels::Rect projected_box(const Camera& camera, const Box3& box, double* fraction_inside) {
    // A grid over the box's faces would be exact with distortion; its corners and midpoints suffice, because
    // callers add a margin.
    double u0 = std::numeric_limits<double>::infinity(), v0 = u0, u1 = -u0, v1 = -u0;
    int behind = 0;
    for (int n = 0; n < 27; ++n) {
        const int row = n / 3, layer = n / 9;
        const double x = 0.5 * (n % 3), y = 0.5 * (row % 3), z = 0.5 * layer;
        const Vec3 p{box.min_in_world.x + x * (box.max_in_world.x - box.min_in_world.x),
                     box.min_in_world.y + y * (box.max_in_world.y - box.min_in_world.y),
                     box.min_in_world.z + z * (box.max_in_world.z - box.min_in_world.z)};
        const auto pixel = camera.project(p);
        if (!pixel) {
            ++behind;
            continue;
        }
        u0 = std::min(u0, pixel->x), u1 = std::max(u1, pixel->x);
        v0 = std::min(v0, pixel->y), v1 = std::max(v1, pixel->y);
    }
    if (fraction_inside) *fraction_inside = 0;
    if (behind == 27) return {};
    if (behind > 0) {
        if (fraction_inside) *fraction_inside = 0.5;
        return {0, 0, camera.width, camera.height};
    }
    const double width = camera.width, height = camera.height;
    const kernels::Rect inside{static_cast<int>(std::floor(std::clamp(u0, 0.0, width))),
                               static_cast<int>(std::floor(std::clamp(v0, 0.0, height))),
                               static_cast<int>(std::ceil(std::clamp(u1 + 1, 0.0, width))),
                               static_cast<int>(std::ceil(std::clamp(v1 + 1, 0.0, height)))};
    if (inside.empty()) return {};
    if (fraction_inside)
        *fraction_inside = std::min(1.0, static_cast<double>(inside.width()) * inside.height() /
                                             std::max(1.0, (u1 - u0 + 1) * (v1 - v0 + 1)));
    return inside;
}

bool shows(const Camera& camera, Vec3 in_world) {
    const auto pixel = camera.project(in_world);
    return pixel && pixel->x >= 0 && pixel->y >= 0 && pixel->x < camera.width && pixel->y < camera.height;
}

std::optional<Box3> missing_legs_space(Vec3 centre_in_world, double missing_below_m) {
    if (missing_below_m <= kMaxFeetHeight_m) return std::nullopt;
    const Vec3& c = centre_in_world;
    return Box3{{c.x - kMaxStride_m, c.y - kMaxStride_m, 0},
                {c.x + kMaxStride_m, c.y + kMaxStride_m, missing_below_m}};
}

double nearest_depth(const Camera& camera, const Box3& box) {
    double nearest = std::numeric_limits<double>::infinity();
    for (int n = 0; n < 8; ++n) {
        const Vec3 corner{n & 1 ? box.max_in_world.x : box.min_in_world.x,
                          n & 2 ? box.max_in_world.y : box.min_in_world.y,
                          n & 4 ? box.max_in_world.z : box.min_in_world.z};
        nearest = std::min(nearest, (camera.camera_from_world * corner).z);
    }
    return nearest;
}

kernels::Rect cropped_to(const kernels::Rect& bounds, const Camera& camera, const Box3& box) {
    constexpr int kMargin_px = 8;  // distortion bends the edges of a box
    const kernels::Rect r = projected_box(camera, box);
    if (r.empty()) return {};
    return intersection_of(bounds,
                           {r.x0 - kMargin_px, r.y0 - kMargin_px, r.x1 + kMargin_px, r.y1 + kMargin_px});
}

}  // namespace kinevox
