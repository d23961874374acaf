#include "server/calibration/silhouette_refine.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>

#include "common/degrees.h"
#include "server/calibration/silhouette_rays.h"
#include "server/calibration/silhouette_tangents.h"
#include "server/calibration/triangulation.h"

namespace kinevox {
namespace {

constexpr double kRaysPerSample = 400;  // and by one pixel squared
constexpr int kMinRefined = 5;
constexpr double kDamping = 1e-5,
                 kMinDamping = 1e-9;  // of the diagonal: more would stop steps along flat valleys

Camera moved(const Camera& camera, const Eigen::Matrix<double, 6, 1>& step) {
    Camera out = camera;
    const Rigid3 change{rotation_from_rodrigues({step(0), step(1), step(2)}), {step(3), step(4), step(5)}};
    out.camera_from_world = change * camera.camera_from_world;
    return out;
}

// Pulls towards the places given: weak where silhouettes say anything.
void add_prior(const std::vector<Camera>& now, const std::vector<Camera>& given,
               const SilhouetteRefineOptions& options, PlacesNormal& normal) {
    // Enough to hold scale and world, which silhouettes leave open; anything stronger bends the places.
    const double turn_weight = kRaysPerSample * std::pow(1 / radians(options.prior_angle_deg), 2);
    const double shift_weight = kRaysPerSample * std::pow(1 / options.prior_shift_m, 2);
    for (std::size_t c = 0; c < now.size(); ++c) {
        const Rigid3 change = now[c].camera_from_world * given[c].camera_from_world.inverse();
        const Vec3 turn = rodrigues_from_rotation(change.rotation), shift = change.translation;
        const bool fixed = c < options.fixed.size() && options.fixed[c];
        const double values[6] = {turn.x, turn.y, turn.z, shift.x, shift.y, shift.z};
        for (int k = 0; k < 6; ++k) {
            const double weight = fixed ? 1e12 : k < 3 ? turn_weight : shift_weight;
            normal.square(6 * c + k, 6 * c + k) += weight;
            normal.right(6 * c + k) -= weight * values[k];
        }
    }
}

double spread_of(const std::vector<Camera>& cameras) {
    Vec3 middle;
    for (const Camera& camera : cameras)
        middle += camera.centre_in_world() / static_cast<double>(cameras.size());
    double squares = 0;
    for (const Camera& camera : cameras) {
        const Vec3 off = camera.centre_in_world() - middle;
        squares += dot(off, off);
    }
    return std::sqrt(squares);
}

// Silhouettes leave the scale open; it stays as it was.
void keep_spread(double spread, std::vector<Camera>& cameras) {
    const double now = spread_of(cameras);
    if (spread > 0 && now > 0) move_cameras({spread / now, {}}, cameras);
}

double mean(const std::vector<double>& values) {
    double sum = 0;
    for (const double value : values) sum += value;
    return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

double mean_miss(const OutlineRays& rays, const std::vector<Camera>& cameras, double scale_px) {
    return mean(rays.measure(cameras, scale_px, false).camera_cost);
}

// What is minimised: the rays' misses and the touching planes'.
class Misses {
  public:
    Misses(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
           const SilhouetteRefineOptions& options)
        : options_(options), rays_(cameras, silhouettes, options) {
        if (options.tangent_weight > 0) tangents_.emplace(cameras, silhouettes);
    }

    const OutlineRays& rays() const { return rays_; }

    PlacesNormal measure(const std::vector<Camera>& cameras, double scale_px, bool with_derivatives) const {
        PlacesNormal sum = rays_.measure(cameras, scale_px, with_derivatives);
        if (!tangents_) return sum;
        const double weight = options_.tangent_weight;
        const PlacesNormal more =
            tangents_->measure(cameras, options_.tangent_scale * scale_px, with_derivatives);
        sum.cost += weight * more.cost;
        if (with_derivatives) sum.square += weight * more.square, sum.right += weight * more.right;
        return sum;
    }

  private:
    const SilhouetteRefineOptions& options_;
    OutlineRays rays_;
    std::optional<SilhouetteTangents> tangents_;
};

}  // namespace

double max_side_px(const std::vector<Camera>& cameras) {
    int side = 1;
    for (const Camera& camera : cameras) side = std::max({side, camera.width, camera.height});
    return side;
}

void align_to(const std::vector<Camera>& like, std::vector<Camera>& cameras) {
    // Points a metre before and beside each camera say where it looks, too. Those that disagree count less
    // and less.
    std::vector<Vec3> from, to;
    std::vector<double> weights(cameras.size(), 1);
    const auto points_of = [](const Camera& camera, double reach, std::vector<Vec3>& points) {
        const Rigid3 world_from_camera = camera.camera_from_world.inverse();
        for (const Vec3 p : {Vec3{0, 0, 0}, Vec3{reach, 0, 0}, Vec3{0, reach, 0}, Vec3{0, 0, reach}})
            points.push_back(world_from_camera * p);
    };
    const std::vector<Camera> start = cameras;
    for (int round = 0; round < 20; ++round) {
        from.clear(), to.clear();
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            const int copies =
                std::max(1, static_cast<int>(std::lround(20 * weights[c])));  // umeyama knows no weights
            for (int k = 0; k < copies; ++k) {
                points_of(start[c], 1, from);
                points_of(like[c], 1, to);
            }
        }
        const auto alignment = align_points(from, to, cameras.size() > 1);
        if (!alignment) return;
        cameras = start;
        move_cameras(*alignment, cameras);
        double most = 0;
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            const double miss =
                norm(cameras[c].centre_in_world() - like[c].centre_in_world()) +
                angle_between(cameras[c].camera_from_world.rotation, like[c].camera_from_world.rotation);
            weights[c] = 1 / (0.02 + miss);
            most = std::max(most, weights[c]);
        }
        for (double& weight : weights) weight /= most;
    }
}

double silhouette_miss_px(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                          const SilhouetteRefineOptions& options) {
    const OutlineRays rays(cameras, silhouettes, options);
    return mean_miss(rays, cameras, 2 * options.last_scale_part * max_side_px(cameras));
}

absl::StatusOr<SilhouetteRefineResult> refine_from_silhouettes(const std::vector<Camera>& cameras,
                                                               const SilhouetteSet& silhouettes,
                                                               const SilhouetteRefineOptions& options,
                                                               const SolveProgress& progress) {
    const Misses misses(cameras, silhouettes, options);
    const OutlineRays& rays = misses.rays();
    if (rays.moments() < kMinRefined)
        return absl::FailedPreconditionError(
            fmt::format("the person is seen by two cameras in {} moments, at least {} are needed; let a "
                        "person walk where all see them",
                        rays.moments(), kMinRefined));
    const double side = max_side_px(cameras);
    const double first = options.first_scale_part * side, last = options.last_scale_part * side;
    SilhouetteRefineResult result;
    result.cameras = cameras;
    result.miss_before_px = mean_miss(rays, cameras, 2 * last);
    double damping = kDamping;
    int stuck = 0;
    const double spread = spread_of(cameras);
    for (int round = 0; round < options.rounds; ++round) {
        if (progress && !progress(static_cast<double>(round) / options.rounds,
                                  fmt::format("silhouettes, round {}", round + 1)))
            return absl::CancelledError("stopped; nothing was changed");
        const double part = std::min(1.0, 1.5 * round / options.rounds);
        const double scale = first * std::pow(last / first, part);
        PlacesNormal normal = misses.measure(result.cameras, scale, true);
        add_prior(result.cameras, cameras, options, normal);
        bool better = false;
        double step_size = 0;
        for (int attempt = 0; attempt < 9 && !better; ++attempt) {
            Eigen::MatrixXd damped = normal.square;
            damped.diagonal() *= 1 + damping;
            const Eigen::VectorXd step = damped.ldlt().solve(normal.right);
            std::vector<Camera> tried;
            for (std::size_t c = 0; c < cameras.size(); ++c)
                tried.push_back(moved(result.cameras[c], step.segment<6>(6 * static_cast<Eigen::Index>(c))));
            if (options.fixed.empty()) keep_spread(spread, tried);
            if (step.allFinite() && misses.measure(tried, scale, false).cost < normal.cost) {
                result.cameras = tried;
                damping = std::max(kMinDamping, damping / 10);
                step_size = step.norm();
                better = true;
            } else {
                damping *= 10;
            }
        }
        ++result.rounds;
        if (!better) damping = kDamping;
        stuck = better && step_size > 1e-5 ? 0 : stuck + 1;
        if (part >= 1 && stuck >= 2) break;
    }
    align_to(cameras, result.cameras);
    result.miss_after_px = mean_miss(rays, result.cameras, 2 * last);
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        result.turned_deg.push_back(degrees(angle_between(cameras[c].camera_from_world.rotation,
                                                          result.cameras[c].camera_from_world.rotation)));
        result.moved_m.push_back(norm(cameras[c].centre_in_world() - result.cameras[c].centre_in_world()));
    }
    return result;
}

absl::StatusOr<std::optional<PlacesUncertainty>> places_uncertainty(const std::vector<Camera>& cameras,
                                                                    const SilhouetteSet& silhouettes,
                                                                    SilhouetteRefineOptions options,
                                                                    const SolveProgress& progress) {
    const std::size_t all = silhouettes.moments.size();
    options.max_moments = (options.max_moments + 1) / 2;
    options.rounds = (options.rounds + 1) / 2;
    std::vector<Camera> places[2];
    for (const std::size_t half : {0, 1}) {
        SilhouetteSet some;
        some.moments.assign(silhouettes.moments.begin() + static_cast<std::ptrdiff_t>(half * all / 2),
                            silhouettes.moments.begin() + static_cast<std::ptrdiff_t>((half + 1) * all / 2));
        const auto refined = refine_from_silhouettes(cameras, some, options, progress);
        if (absl::IsCancelled(refined.status())) return refined.status();
        if (!refined.ok()) return std::optional<PlacesUncertainty>();
        places[half] = refined->cameras;
    }
    std::vector<Vec3> from, to;
    for (std::size_t c = 0; c < cameras.size(); ++c)
        from.push_back(places[0][c].centre_in_world()), to.push_back(places[1][c].centre_in_world());
    const auto alignment = align_points(from, to, cameras.size() > 2);
    if (!alignment) return std::optional<PlacesUncertainty>();
    move_cameras(*alignment, places[0]);
    PlacesUncertainty worst;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        worst.centre_mm = std::max(worst.centre_mm, 1000 * norm(places[0][c].centre_in_world() - to[c]));
        worst.turn_deg =
            std::max(worst.turn_deg, degrees(angle_between(places[0][c].camera_from_world.rotation,
                                                           places[1][c].camera_from_world.rotation)));
    }
    return std::optional(worst);
}

}  // namespace kinevox
