#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "common/to_eigen.h"
#include "server/calibration/multi_view.h"
#include "server/calibration/person/silhouette_residuals.h"

namespace kinevox {
namespace {

constexpr double kMinDepth_m = 0.3;
constexpr double kOutsidePx = 60;  // cost of a point outside a camera's image

// Pixel of a point in the camera frame. Its derivatives ignore the distortion: that changes the steps by a
// few percent, not the solution.
bool project(const Camera& camera, Vec3 in_camera, float& x, float& y) {
    if (!(in_camera.z > 0.05)) return false;
    const double u = in_camera.x / in_camera.z, v = in_camera.y / in_camera.z, r2 = u * u + v * v;
    const double radial = 1 + r2 * (camera.k1 + r2 * (camera.k2 + r2 * camera.k3));
    x = static_cast<float>(camera.fx * (u * radial + 2 * camera.p1 * u * v + camera.p2 * (r2 + 2 * u * u)) +
                           camera.cx);
    y = static_cast<float>(camera.fy * (v * radial + camera.p1 * (r2 + 2 * v * v) + 2 * camera.p2 * u * v) +
                           camera.cy);
    return r2 < 4;
}

Eigen::Matrix3d skew(Vec3 v) {
    Eigen::Matrix3d m;
    m << 0, -v.z, v.y, v.z, 0, -v.x, -v.y, v.x, 0;
    return m;
}

}  // namespace

ContourRayCost::ContourRayCost(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                               const SilhouetteRefineOptions& options)
    : options_(options), margin_px_(options.margin_fraction * max_side_px(cameras)) {
    std::vector<std::size_t> usable;
    for (std::size_t m = 0; m < silhouettes.frame_sets.size(); ++m) {
        const auto seen = std::count_if(silhouettes.frame_sets[m].begin(), silhouettes.frame_sets[m].end(),
                                        [](const SilhouetteMask& s) { return !s.empty(); });
        if (seen >= 2) usable.push_back(m);
    }
    const std::size_t wanted = std::min<std::size_t>(usable.size(), options.max_frame_sets);
    fields_.resize(wanted);
    oneapi::tbb::parallel_for(std::size_t{0}, wanted, [&](std::size_t n) {
        const auto& images = silhouettes.frame_sets[usable[n * usable.size() / wanted]];
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            fields_[n].push_back(nullptr);
            if (images[c].empty()) continue;
            auto field =
                std::make_unique<SilhouetteField>(images[c].mask, cameras[c].width, cameras[c].height);
            if (!field->empty()) fields_[n].back() = std::move(field);
        }
    });
    for (std::size_t n = 0; n < wanted; ++n)
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            if (!fields_[n][c]) continue;
            for (const Vec2 pixel : fields_[n][c]->contour(options.contour_points))
                rays_.push_back(
                    {static_cast<int>(n), static_cast<int>(c), direction_in_camera(cameras[c], pixel)});
        }
    depths_.assign(rays_.size(), 0);
}

std::vector<Vec3> ContourRayCost::centres(const std::vector<Camera>& cameras) const {
    std::vector<Vec3> out;
    for (const auto& fields : fields_) {
        std::vector<Observation> observations;
        for (std::size_t c = 0; c < cameras.size(); ++c)
            if (fields[c])
                observations.push_back({&cameras[c],
                                        {0.5 * (fields[c]->left + fields[c]->right),
                                         0.5 * (fields[c]->top + fields[c]->bottom)}});
        const auto middle = triangulate(observations);
        out.push_back(middle ? *middle : out.empty() ? Vec3{} : out.back());
    }
    return out;
}

double ContourRayCost::squares_at(const std::vector<Camera>& cameras, const ContourRay& ray,
                                  Vec3 point) const {
    double squares = 0;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        const auto& field = fields_[ray.frame_set][c];
        if (!field || static_cast<int>(c) == ray.camera) continue;
        float x, y;
        const Vec3 in_camera = cameras[c].camera_from_world * point;
        const double inside =
            project(cameras[c], in_camera, x, y) ? field->distance(x, y) - margin_px_ : std::nan("");
        // A point that this camera cannot see is neither consistent nor inconsistent; a small residual keeps
        // it from attracting the ray.
        const double residual = std::isnan(inside) ? 0.1 * kOutsidePx : std::min(0.0, inside);
        squares += residual * residual;
    }
    return squares;
}

ContourRayCost::Hit ContourRayCost::search(const std::vector<Camera>& cameras, const ContourRay& ray,
                                           Vec3 middle) const {
    const Rigid3 world_from_camera = cameras[ray.camera].camera_from_world.inverse();
    const Vec3 origin = world_from_camera.translation,
               along = world_from_camera.rotation * ray.direction_in_camera;
    const double centre = dot(middle - origin, along);
    Hit best{0, 1e300};
    const auto try_depth = [&](double depth) {
        if (depth < kMinDepth_m) return;
        const double squares = squares_at(cameras, ray, origin + depth * along);
        if (squares < best.squares) best = {depth, squares};
    };
    const int steps = static_cast<int>(options_.radius_m / options_.depth_step_m) / 4;
    for (int k = 0; k <= 2 * steps && best.squares > 0;
         ++k)  // coarse, from the centre outwards; then around the best
        try_depth(centre + 4 * (k % 2 ? (k + 1) / 2 : -k / 2) * options_.depth_step_m);
    for (double step = 2 * options_.depth_step_m; step > 0.4 * options_.depth_step_m && best.squares > 0;
         step /= 2) {
        const double at = best.depth;
        try_depth(at - step);
        try_depth(at + step);
    }
    polish(cameras, ray, best);
    return best;
}

ContourRayCost::Hit ContourRayCost::follow(const std::vector<Camera>& cameras, const ContourRay& ray,
                                           double depth) const {
    const Rigid3 world_from_camera = cameras[ray.camera].camera_from_world.inverse();
    const auto squares = [&](double at) {
        return squares_at(cameras, ray, world_from_camera * (at * ray.direction_in_camera));
    };
    Hit best{depth, squares(depth)};
    const double step = 0.5 * options_.depth_step_m;
    for (const double at : {depth - step, depth + step})
        if (best.squares > 0 && at > kMinDepth_m)
            if (const double there = squares(at); there < best.squares) best = {at, there};
    polish(cameras, ray, best);
    return best;
}

void ContourRayCost::polish(const std::vector<Camera>& cameras, const ContourRay& ray, Hit& hit) const {
    const Rigid3 world_from_own = cameras[ray.camera].camera_from_world.inverse();
    for (int round = 0; round < 4 && hit.squares > 0; ++round) {
        const Vec3 point = world_from_own * (hit.depth * ray.direction_in_camera);
        double gradient = 0, curvature = 1e-9;
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            const auto& field = fields_[ray.frame_set][c];
            if (!field || static_cast<int>(c) == ray.camera) continue;
            const Vec3 in_camera = cameras[c].camera_from_world * point;
            float x, y, dx, dy;
            if (!project(cameras[c], in_camera, x, y)) continue;
            const double inside = field->distance(x, y, dx, dy) - margin_px_;
            if (std::isnan(inside) || inside >= 0) continue;
            const Vec3 along =
                cameras[c].camera_from_world.rotation * (world_from_own.rotation * ray.direction_in_camera);
            const double by_depth = (dx * cameras[c].fx * (along.x - in_camera.x / in_camera.z * along.z) +
                                     dy * cameras[c].fy * (along.y - in_camera.y / in_camera.z * along.z)) /
                                    in_camera.z;
            gradient += inside * by_depth, curvature += by_depth * by_depth;
        }
        const double step = std::clamp(-gradient / curvature, -options_.depth_step_m, options_.depth_step_m);
        const double depth = hit.depth + step;
        if (!(depth > kMinDepth_m) || std::abs(step) < 1e-5) return;
        const double squares = squares_at(cameras, ray, world_from_own * (depth * ray.direction_in_camera));
        if (!(squares < hit.squares)) return;
        hit = {depth, squares};
    }
}

void ContourRayCost::add(const std::vector<Camera>& cameras, const ContourRay& ray, const Hit& hit,
                         double weight, PoseNormalEquations& normal) const {
    const int count = static_cast<int>(cameras.size());
    const Vec3 in_own = hit.depth * ray.direction_in_camera;
    const Rigid3 world_from_own = cameras[ray.camera].camera_from_world.inverse();
    const Vec3 point = world_from_own * in_own;
    // Rows: one per camera with a residual. Columns: rotation and translation of the own camera, of the
    // other; and the depth.
    struct Row {
        int other;
        double residual, by_depth;
        Eigen::Matrix<double, 1, 6> by_own, by_other;
    };
    std::vector<Row> rows;
    double depth_square = 0;
    for (int c = 0; c < count; ++c) {
        const auto& field = fields_[ray.frame_set][c];
        if (!field || c == ray.camera) continue;
        const Vec3 in_camera = cameras[c].camera_from_world * point;
        float x, y, dx, dy;
        if (!project(cameras[c], in_camera, x, y)) continue;
        const float inside = field->distance(x, y, dx, dy) - static_cast<float>(margin_px_);
        if (std::isnan(inside) || inside >= 0) continue;
        const double fx = cameras[c].fx / in_camera.z, fy = cameras[c].fy / in_camera.z;
        const Eigen::RowVector3d by_point(dx * fx, dy * fy,
                                          -(dx * fx * in_camera.x + dy * fy * in_camera.y) / in_camera.z);
        const Eigen::Matrix3d other_from_own =
            to_eigen(cameras[c].camera_from_world.rotation) * to_eigen(world_from_own.rotation);
        Row row;
        row.other = c;
        row.residual = inside;
        row.by_other << -by_point * skew(in_camera), by_point;
        const Eigen::RowVector3d by_own_point = by_point * other_from_own;
        row.by_own << by_own_point * skew(in_own), -by_own_point;
        row.by_depth = by_own_point * to_eigen(ray.direction_in_camera);
        depth_square += row.by_depth * row.by_depth;
        rows.push_back(row);
    }
    // The depth is free: eliminated by variable projection.
    const int own = 6 * ray.camera;
    depth_square += 1e-6;
    for (const Row& a : rows)
        for (const Row& b : rows) {
            const double left = weight * ((&a == &b ? 1.0 : 0.0) - a.by_depth * b.by_depth / depth_square);
            const int other_a = 6 * a.other, other_b = 6 * b.other;
            normal.square.block<6, 6>(own, own) += left * a.by_own.transpose() * b.by_own;
            normal.square.block<6, 6>(own, other_b) += left * a.by_own.transpose() * b.by_other;
            normal.square.block<6, 6>(other_a, own) += left * a.by_other.transpose() * b.by_own;
            normal.square.block<6, 6>(other_a, other_b) += left * a.by_other.transpose() * b.by_other;
            normal.right.segment<6>(own) -= left * b.residual * a.by_own.transpose();
            normal.right.segment<6>(other_a) -= left * b.residual * a.by_other.transpose();
        }
}

PoseNormalEquations ContourRayCost::measure(const std::vector<Camera>& cameras, double scale_px,
                                            bool with_derivatives) const {
    const int size = 6 * static_cast<int>(cameras.size());
    const std::vector<Vec3> middle = centres(cameras);
    // Fixed blocks summed in their order, so that the numbers do not depend on the threads.
    constexpr std::size_t kBlock = 256;
    const std::size_t blocks = (rays_.size() + kBlock - 1) / kBlock;
    std::vector<PoseNormalEquations> parts(blocks);
    oneapi::tbb::parallel_for(std::size_t{0}, blocks, [&](std::size_t b) {
        PoseNormalEquations& part = parts[b];
        part.camera_cost.assign(cameras.size(), 0);
        if (with_derivatives) part.square.setZero(size, size), part.right.setZero(size);
        for (std::size_t r = b * kBlock; r < std::min(rays_.size(), (b + 1) * kBlock); ++r) {
            const ContourRay& ray = rays_[r];
            const Hit hit = with_derivatives || depths_[r] == 0 ? search(cameras, ray, middle[ray.frame_set])
                                                                : follow(cameras, ray, depths_[r]);
            if (with_derivatives) depths_[r] = hit.depth;
            const double scale2 = scale_px * scale_px, ratio = scale2 / (scale2 + hit.squares);
            part.cost += hit.squares * ratio;  // Geman-McClure
            part.camera_cost[ray.camera] += std::sqrt(hit.squares * ratio);
            if (with_derivatives && hit.squares > 0) add(cameras, ray, hit, ratio * ratio, part);
        }
    });
    PoseNormalEquations sum;
    sum.camera_cost.assign(cameras.size(), 0);
    if (with_derivatives) sum.square.setZero(size, size), sum.right.setZero(size);
    for (const PoseNormalEquations& part : parts) {
        sum.cost += part.cost;
        for (std::size_t c = 0; c < cameras.size(); ++c) sum.camera_cost[c] += part.camera_cost[c];
        if (with_derivatives) sum.square += part.square, sum.right += part.right;
    }
    std::vector<int> own(cameras.size(), 0);
    for (const ContourRay& ray : rays_) ++own[ray.camera];
    for (std::size_t c = 0; c < cameras.size(); ++c) sum.camera_cost[c] /= std::max(1, own[c]);
    return sum;
}

}  // namespace kinevox
