#include "server/calibration/person/person_world.h"

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

#include "common/geometry.h"
#include "common/median.h"
#include "common/to_eigen.h"
#include "server/calibration/person/silhouette_hull.h"

namespace kinevox {
namespace {

constexpr double kLeanStd_rad = 0.06;       // of a walking body's mean axis
constexpr double kFloorStdFraction = 0.02;  // of the height: of the lowest point of a hull, about the floor
constexpr double kUprightQuantile = 0.75, kTallQuantile = 0.97;  // of the heights of the hulls
constexpr int kMinHulls = 5;

double quantile(std::vector<double> values, double fraction) {
    std::sort(values.begin(), values.end());
    return values[static_cast<std::size_t>(fraction * static_cast<double>(values.size() - 1))];
}

std::vector<SilhouetteHull::Extent> extents(const std::vector<Camera>& cameras,
                                            const SilhouetteSet& silhouettes, Vec3 up) {
    std::vector<std::optional<SilhouetteHull::Extent>> all(silhouettes.frame_sets.size());
    oneapi::tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t m) {
        for (const SilhouetteMask& image : silhouettes.frame_sets[m])
            if (!image.empty() && image.truncated) return;  // head or feet may be missing
        const SilhouetteHull hull(cameras, silhouettes.frame_sets[m]);
        if (hull.usable()) all[m] = hull.extent(up);
    });
    std::vector<SilhouetteHull::Extent> found;
    for (const auto& extent : all)
        if (extent) found.push_back(*extent);
    return found;
}

// The floor's normal: the plane through the lowest points, with the body's axis as prior across the path.
Vec3 normal_of_floor(const std::vector<SilhouetteHull::Extent>& extents, Vec3 up, double height) {
    const Eigen::Vector3d axis = to_eigen(up);
    const Eigen::Vector3d side = axis.unitOrthogonal(), front = axis.cross(side);
    Eigen::Vector3d mean = Eigen::Vector3d::Zero();
    for (const auto& extent : extents) mean += to_eigen(extent.lowest) / static_cast<double>(extents.size());
    Eigen::Matrix2d square = Eigen::Matrix2d::Identity() / (kLeanStd_rad * kLeanStd_rad);
    Eigen::Vector2d right = Eigen::Vector2d::Zero();
    const double weight = 1 / std::pow(kFloorStdFraction * height, 2);
    for (const auto& extent : extents) {
        const Eigen::Vector3d p = to_eigen(extent.lowest) - mean;
        const Eigen::Vector2d flat(p.dot(side), p.dot(front));
        square += weight * flat * flat.transpose();
        right += weight * p.dot(axis) * flat;
    }
    const Eigen::Vector2d slope = square.ldlt().solve(right);
    const Eigen::Vector3d normal = (axis - slope(0) * side - slope(1) * front).normalized();
    return from_eigen(normal);
}

// Along the main direction of the subject's positions, and across it; in world lengths.
void measure_way(const std::vector<SilhouetteHull::Extent>& extents, PersonWorld& world) {
    std::vector<Vec3> positions;
    for (const auto& extent : extents)
        positions.push_back(world.world_from_solved(0.5 * (extent.lowest + extent.highest)));
    double xx = 0, xy = 0, yy = 0;
    Vec3 mean;
    for (const Vec3 p : positions) mean += p / static_cast<double>(positions.size());
    for (const Vec3 p : positions)
        xx += (p.x - mean.x) * (p.x - mean.x), xy += (p.x - mean.x) * (p.y - mean.y),
            yy += (p.y - mean.y) * (p.y - mean.y);
    const double angle = 0.5 * std::atan2(2 * xy, xx - yy);
    std::vector<double> along, across;
    for (const Vec3 p : positions) {
        along.push_back(std::cos(angle) * p.x + std::sin(angle) * p.y);
        across.push_back(std::cos(angle) * p.y - std::sin(angle) * p.x);
    }
    world.way_long_m = quantile(along, 0.97) - quantile(along, 0.03);
    world.way_wide_m = quantile(across, 0.97) - quantile(across, 0.03);
}

using Vector = Eigen::Vector3d;

constexpr double kStanding = 2.5;  // variance along the body over that across it: larger for an upright body
constexpr std::size_t kMinVoxels = 400;
constexpr std::size_t kLowVoxels = 6;   // voxels below the lowest point that counts
constexpr double kSoleHeight_m = 0.03;  // height above the lowest point of the voxels that locate the foot
constexpr double kFeetHeight_m = 0.15;  // and of those that locate both feet
constexpr std::size_t kMinFrameSets = 6;
constexpr double kNotWalked_m = 0.5;
constexpr double kNarrow_m = 0.12, kUnsure_deg = 1.0;

struct CarvedBody {
    std::vector<Vector> voxels;
    Vector middle, axis;  // of the body; zero axis if it is not elongated
};

std::vector<CarvedBody> carve_all(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                                  const FloorPersonOptions& options, const SolveProgress& progress,
                                  bool& cancelled) {
    SubjectHull hull(cameras, {});
    std::vector<CarvedBody> out;
    const std::size_t all = silhouettes.frame_sets.size(),
                      used = std::min<std::size_t>(all, options.max_frame_sets);
    for (std::size_t n = 0; n < used && !cancelled; ++n) {
        cancelled = progress && !progress(0.9 * n / used, "the person's hull");
        const auto& images = silhouettes.frame_sets[n * all / used];
        if (!hull.carve(images)) continue;
        CarvedBody body;
        for (const Vec3 p : hull.voxels()) body.voxels.emplace_back(p.x, p.y, p.z);
        if (body.voxels.size() < kMinVoxels) continue;
        body.middle.setZero();
        for (const Vector& p : body.voxels) body.middle += p / static_cast<double>(body.voxels.size());
        Eigen::Matrix3d spread = Eigen::Matrix3d::Zero();
        for (const Vector& p : body.voxels) spread += (p - body.middle) * (p - body.middle).transpose();
        const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(spread);
        body.axis = axes.eigenvalues()(2) > kStanding * axes.eigenvalues()(1)
                        ? Vector(axes.eigenvectors().col(2))
                        : Vector(Vector::Zero());
        out.push_back(std::move(body));
    }
    return out;
}

// Mean up direction of the images: distinguishes head from feet.
Vector up_in_images(const std::vector<Camera>& cameras) {
    Vector up = Vector::Zero();
    for (const Camera& camera : cameras) {
        const Mat3& r = camera.camera_from_world.rotation;
        up -= Vector(r(1, 0), r(1, 1), r(1, 2));
    }
    return up.norm() > 1e-6 ? Vector(up.normalized()) : Vector(0, 0, 1);
}

// Two directions across `up`.
void across(const Vector& up, Vector& u, Vector& v) {
    u = up.cross(std::abs(up.z()) < 0.9 ? Vector(0, 0, 1) : Vector(1, 0, 0)).normalized();
    v = up.cross(u);
}

struct Lowest {
    Vector point = Vector::Zero();
    Vector between_feet = Vector::Zero();  // the other foot may be in the air
};

// The lowest point of a body along `up`: at the height below which almost nothing lies, above the centre of
// the voxels near it.
Lowest lowest(const CarvedBody& body, const Vector& up) {
    std::vector<double> heights;
    for (const Vector& p : body.voxels) heights.push_back(up.dot(p));
    std::vector<double> sorted = heights;
    std::nth_element(sorted.begin(), sorted.begin() + kLowVoxels, sorted.end());
    const double low = sorted[kLowVoxels];
    Lowest out;
    int count = 0, feet = 0;
    for (std::size_t i = 0; i < heights.size(); ++i) {
        if (heights[i] < low + kSoleHeight_m) out.point += body.voxels[i], ++count;
        if (heights[i] < low + kFeetHeight_m) out.between_feet += body.voxels[i], ++feet;
    }
    out.point /= count, out.between_feet /= feet;
    out.point += (low - up.dot(out.point)) * up;
    return out;
}

struct Plane {
    Vector up;
    double height = 0;  // of the floor along up
    double tilt_std = 0, rms_m = 0, narrow_m = 0;
    std::vector<Vector> contacts;
};

Plane fit_plane(const std::vector<CarvedBody>& bodies, Vector upright, const FloorPersonOptions& options) {
    Plane plane;
    plane.up = upright;
    constexpr int kSoftRounds = 6, kRounds = 12;
    double softness_m = 0.4;
    for (int round = 0; round < kRounds; ++round) {
        std::vector<Vector> low, feet;
        std::vector<double> heights;
        for (const CarvedBody& body : bodies) {
            const Lowest found = lowest(body, plane.up);
            low.push_back(found.point), feet.push_back(found.between_feet);
            heights.push_back(plane.up.dot(low.back()));
        }
        if (round == 0) {
            std::vector<double> sorted = heights;
            plane.height = median_of(sorted);
        }
        // At first all points count, closer ones more; then only contacts.
        std::vector<double> weights;
        plane.contacts.clear();
        Vector over_feet = Vector::Zero();
        for (std::size_t i = 0; i < low.size(); ++i) {
            const double above = heights[i] - plane.height;
            const bool touches = above < options.highest_m && above > -options.deepest_m;
            if (round >= kSoftRounds && !touches) continue;
            plane.contacts.push_back(low[i]);
            weights.push_back(round < kSoftRounds ? 1 / (1 + std::pow(above / softness_m, 2)) : 1);
            over_feet += weights.back() * (bodies[i].middle - feet[i]);
        }
        softness_m = std::max(0.03, 0.6 * softness_m);
        if (plane.contacts.size() < kMinFrameSets) break;
        // A person in balance has the body over the feet, on average.
        upright = over_feet.normalized();
        Vector u, v, middle = Vector::Zero();
        across(plane.up, u, v);
        double sum = 0;
        for (std::size_t i = 0; i < plane.contacts.size(); ++i)
            middle += weights[i] * plane.contacts[i], sum += weights[i];
        middle /= sum;
        // up' = up + a u + b v, contacts at one height.
        Eigen::Matrix3d square = Eigen::Matrix3d::Zero();
        Eigen::Matrix2d spread = Eigen::Matrix2d::Zero();
        Vector right = Vector::Zero();
        const double contact = 1 / (options.contact_std_m * options.contact_std_m);
        const double lean = 1 / (options.lean_std_rad * options.lean_std_rad);
        for (std::size_t i = 0; i < plane.contacts.size(); ++i) {
            const Vector d = plane.contacts[i] - middle, row(u.dot(d), v.dot(d), -1);
            square += weights[i] * contact * row * row.transpose();
            right -= weights[i] * contact * plane.up.dot(d) * row;
            spread += weights[i] / sum * row.head<2>() * row.head<2>().transpose();
        }
        plane.narrow_m =
            std::sqrt(std::max(0.0, Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(spread).eigenvalues()(0)));
        square(0, 0) += lean, square(1, 1) += lean;
        right(0) += lean * u.dot(upright), right(1) += lean * v.dot(upright);
        const Vector step = square.ldlt().solve(right);
        const Eigen::Matrix2d tilt = square.inverse().topLeftCorner<2, 2>();
        plane.tilt_std = std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d>(tilt).eigenvalues()(1));
        plane.up = (plane.up + step(0) * u + step(1) * v).normalized();
        double height = 0, squares = 0;
        for (std::size_t i = 0; i < plane.contacts.size(); ++i)
            height += weights[i] / sum * plane.up.dot(plane.contacts[i]);
        plane.height = height;
        for (const Vector& p : plane.contacts) squares += std::pow(plane.up.dot(p) - plane.height, 2);
        plane.rms_m = std::sqrt(squares / static_cast<double>(plane.contacts.size()));
    }
    return plane;
}

// Origin at the centre of the path, x from its start to its farthest point.
Rigid3 world_on_floor(const std::vector<Camera>& cameras, const std::vector<CarvedBody>& bodies,
                      const Plane& plane) {
    std::vector<Vector> path;
    Vector centre = Vector::Zero();
    for (const CarvedBody& body : bodies) {
        path.push_back(body.middle - (plane.up.dot(body.middle) - plane.height) * plane.up);
        centre += path.back() / static_cast<double>(bodies.size());
    }
    const Vector start = path.front();
    const Vector farthest = *std::max_element(
        path.begin(), path.end(),
        [&](const Vector& a, const Vector& b) { return (a - start).norm() < (b - start).norm(); });
    Vector x = farthest - start;
    if (x.norm() <= kNotWalked_m) {
        const Mat3& r = cameras.front().camera_from_world.rotation;
        x = Vector(r(2, 0), r(2, 1), r(2, 2));
        x -= plane.up.dot(x) * plane.up;
        if (x.norm() < 1e-3) x = Vector(r(1, 0), r(1, 1), r(1, 2)), x -= plane.up.dot(x) * plane.up;
    }
    x.normalize();
    const Vector y = plane.up.cross(x);
    const Mat3 rotation{{x.x(), x.y(), x.z(), y.x(), y.y(), y.z(), plane.up.x(), plane.up.y(), plane.up.z()}};
    return {rotation, -(rotation * Vec3{centre.x(), centre.y(), centre.z()})};
}

// From the taller bodies: bending only lowers the height.
double stature_of(const std::vector<CarvedBody>& bodies, const Plane& plane) {
    std::vector<double> heights;
    for (const CarvedBody& body : bodies) {
        std::vector<double> up;
        for (const Vector& p : body.voxels) up.push_back(plane.up.dot(p) - plane.height);
        std::nth_element(up.begin(), up.end() - 1 - kLowVoxels, up.end());
        heights.push_back(*(up.end() - 1 - kLowVoxels));
    }
    std::nth_element(heights.begin(), heights.begin() + heights.size() * 3 / 4, heights.end());
    return heights[heights.size() * 3 / 4];
}

}  // namespace

std::optional<PersonWorld> person_world(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                                        Vec3 up_in_solved, double height_m) {
    Vec3 up = normalized(up_in_solved);
    std::vector<SilhouetteHull::Extent> found;
    PersonWorld world;
    for (int round = 0; round < 2; ++round) {
        found = extents(cameras, silhouettes, up);
        if (found.size() < kMinHulls) return std::nullopt;
        std::vector<double> heights;
        for (const auto& extent : found) heights.push_back(dot(extent.highest - extent.lowest, up));
        world.height_solved = quantile(heights, kUprightQuantile);
        world.uneven_height = quantile(heights, kTallQuantile) / quantile(heights, 0.5);
        if (!(world.height_solved > 0)) return std::nullopt;
        up = normal_of_floor(found, up, world.height_solved);
    }
    world.frame_sets = static_cast<int>(found.size());
    std::vector<double> floors;
    Vec3 middle;
    for (const auto& extent : found) {
        floors.push_back(dot(extent.lowest, up));
        middle += extent.lowest / static_cast<double>(found.size());
    }
    const double scale = height_m / world.height_solved, floor = quantile(floors, 0.5);
    // x: to the right of the first camera.
    const Vec3 right = cameras.front().camera_from_world.rotation.transposed() * Vec3{1, 0, 0};
    const Vec3 x = normalized(right - dot(right, up) * up), y = cross(up, x);
    world.world_from_solved.scale = scale;
    world.world_from_solved.target_from_source.rotation = {{x.x, x.y, x.z, y.x, y.y, y.z, up.x, up.y, up.z}};
    const Vec3 origin = middle - (dot(middle, up) - floor) * up;
    world.world_from_solved.target_from_source.translation =
        -(world.world_from_solved.target_from_source.rotation * (scale * origin));
    measure_way(found, world);
    return world;
}

absl::StatusOr<FloorResult> floor_from_person(const std::vector<Camera>& cameras,
                                              const SilhouetteSet& silhouettes,
                                              const FloorPersonOptions& options,
                                              const SolveProgress& progress) {
    bool cancelled = false;
    const std::vector<CarvedBody> bodies = carve_all(cameras, silhouettes, options, progress, cancelled);
    if (cancelled) return absl::CancelledError("stopped; nothing was written");
    const absl::Status too_few =
        absl::FailedPreconditionError(fmt::format("two cameras see the whole person in {} frame sets; at "
                                                  "least {} are needed; record a walk through the space "
                                                  "that shows the feet in all images",
                                                  bodies.size(), kMinFrameSets));
    if (bodies.size() < kMinFrameSets) return too_few;
    const Vector image_up = up_in_images(cameras);
    Vector upright = Vector::Zero();
    for (const CarvedBody& body : bodies) upright += (body.axis.dot(image_up) < 0 ? -1.0 : 1.0) * body.axis;
    const bool standing = upright.norm() > 0.3 * static_cast<double>(bodies.size());
    upright = standing ? Vector(upright.normalized()) : image_up;
    const Plane plane = fit_plane(bodies, upright, options);
    if (plane.contacts.size() < kMinFrameSets)
        return absl::FailedPreconditionError(
            "the lowest points of the person lie on no common plane; record a walk, and check whether the "
            "silhouettes include the feet");
    if (progress && !progress(0.95, "fitting the floor"))
        return absl::CancelledError("stopped; nothing was written");

    FloorResult result;
    result.method = "person";
    result.world_from_old = world_on_floor(cameras, bodies, plane);
    result.flatness_rms_mm = 1000 * plane.rms_m;
    result.tilt_std_deg = degrees(plane.tilt_std);
    for (const Vector& p : plane.contacts)
        result.on_floor.push_back(result.world_from_old * Vec3{p.x(), p.y(), p.z()});
    result.stature_m = stature_of(bodies, plane);
    if (!standing)
        result.findings.push_back(
            {Verdict::kCaution, "subject_not_upright", "",
             "the person hardly ever stood upright; the vertical is taken from the cameras",
             "record a person who walks upright"});
    if (plane.narrow_m < kNarrow_m || *result.tilt_std_deg > kUnsure_deg)
        result.findings.push_back(
            {Verdict::kCaution, "walk_too_narrow", "",
             fmt::format("the foot contacts cover a strip only {:.1f} m wide: across it the "
                         "floor's tilt relies on an upright body, to about {:.1f} degrees",
                         4 * plane.narrow_m, *result.tilt_std_deg),
             "record a walk in a circle or a figure of eight through the whole space"});
    if (plane.rms_m > 0.02)
        result.findings.push_back(
            {Verdict::kCaution, "floor_contacts", "",
             fmt::format("the foot contacts deviate by {:.0f} mm from a plane", 1000 * plane.rms_m),
             "check whether the silhouettes include the feet; avoid shadows and glossy floors"});
    if (progress && !progress(1, "done")) return absl::CancelledError("stopped; nothing was written");
    return result;
}

}  // namespace kinevox
