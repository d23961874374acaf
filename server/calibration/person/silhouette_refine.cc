#include "server/calibration/person/silhouette_refine.h"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <optional>

#include "common/geometry.h"
#include "server/calibration/multi_view.h"
#include "server/calibration/person/silhouette_residuals.h"

namespace kinevox {
namespace {

constexpr double kRaysPerSample = 400;  // per pixel squared
constexpr int kMinRefined = 5;
constexpr double kDamping = 1e-5,
                 kMinDamping = 1e-9;  // of the diagonal: more would block steps along flat valleys

Camera moved(const Camera& camera, const Eigen::Matrix<double, 6, 1>& step) {
    Camera out = camera;
    const Rigid3 change{rotation_from_rodrigues({step(0), step(1), step(2)}), {step(3), step(4), step(5)}};
    out.camera_from_world = change * camera.camera_from_world;
    return out;
}

// Pulls towards the given poses: weak compared with silhouettes.
void add_prior(const std::vector<Camera>& now, const std::vector<Camera>& given,
               const SilhouetteRefineOptions& options, PoseNormalEquations& normal) {
    // Enough to fix scale and world frame, which silhouettes leave undetermined; a stronger prior biases the
    // poses.
    const double rotation_weight = kRaysPerSample * std::pow(1 / radians(options.prior_angle_deg), 2);
    const double shift_weight = kRaysPerSample * std::pow(1 / options.prior_shift_m, 2);
    for (std::size_t c = 0; c < now.size(); ++c) {
        const Rigid3 change = now[c].camera_from_world * given[c].camera_from_world.inverse();
        const Vec3 rotation = rodrigues_from_rotation(change.rotation), shift = change.translation;
        const bool fixed = c < options.fixed.size() && options.fixed[c];
        const double values[6] = {rotation.x, rotation.y, rotation.z, shift.x, shift.y, shift.z};
        for (int k = 0; k < 6; ++k) {
            const double weight = fixed ? 1e12 : k < 3 ? rotation_weight : shift_weight;
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

// Silhouettes do not determine the scale; it is kept.
void keep_spread(double spread, std::vector<Camera>& cameras) {
    const double now = spread_of(cameras);
    if (spread > 0 && now > 0) move_cameras({spread / now, {}}, cameras);
}

double mean(const std::vector<double>& values) {
    double sum = 0;
    for (const double value : values) sum += value;
    return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

double mean_residual(const ContourRayCost& rays, const std::vector<Camera>& cameras, double scale_px) {
    return mean(rays.measure(cameras, scale_px, false).camera_cost);
}

// The cost: residuals of rays and of tangent planes.
class SilhouetteResiduals {
  public:
    SilhouetteResiduals(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                        const SilhouetteRefineOptions& options)
        : options_(options), rays_(cameras, silhouettes, options) {
        if (options.tangent_weight > 0) tangents_.emplace(cameras, silhouettes);
    }

    const ContourRayCost& rays() const { return rays_; }

    PoseNormalEquations measure(const std::vector<Camera>& cameras, double scale_px,
                                bool with_derivatives) const {
        PoseNormalEquations sum = rays_.measure(cameras, scale_px, with_derivatives);
        if (!tangents_) return sum;
        const double weight = options_.tangent_weight;
        const PoseNormalEquations more =
            tangents_->measure(cameras, options_.tangent_scale * scale_px, with_derivatives);
        sum.cost += weight * more.cost;
        if (with_derivatives) sum.square += weight * more.square, sum.right += weight * more.right;
        return sum;
    }

  private:
    const SilhouetteRefineOptions& options_;
    ContourRayCost rays_;
    std::optional<SilhouetteTangents> tangents_;
};

}  // namespace

double max_side_px(const std::vector<Camera>& cameras) {
    int side = 1;
    for (const Camera& camera : cameras) side = std::max({side, camera.width, camera.height});
    return side;
}

void align_to(const std::vector<Camera>& like, std::vector<Camera>& cameras) {
    // Points one metre from each camera along its axes include the orientation. Outliers are down-weighted.
    std::vector<Vec3> from, to;
    std::vector<double> weights(cameras.size(), 1);
    const auto points_of = [](const Camera& camera, double distance_m, std::vector<Vec3>& points) {
        const Rigid3 world_from_camera = camera.camera_from_world.inverse();
        for (const Vec3 p :
             {Vec3{0, 0, 0}, Vec3{distance_m, 0, 0}, Vec3{0, distance_m, 0}, Vec3{0, 0, distance_m}})
            points.push_back(world_from_camera * p);
    };
    const std::vector<Camera> start = cameras;
    for (int round = 0; round < 20; ++round) {
        from.clear(), to.clear();
        for (std::size_t c = 0; c < cameras.size(); ++c) {
            const int copies =
                std::max(1, static_cast<int>(std::lround(20 * weights[c])));  // umeyama has no weights
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
            const double residual =
                norm(cameras[c].centre_in_world() - like[c].centre_in_world()) +
                angle_between(cameras[c].camera_from_world.rotation, like[c].camera_from_world.rotation);
            weights[c] = 1 / (0.02 + residual);
            most = std::max(most, weights[c]);
        }
        for (double& weight : weights) weight /= most;
    }
}

double silhouette_residual_px(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                              const SilhouetteRefineOptions& options) {
    const ContourRayCost rays(cameras, silhouettes, options);
    return mean_residual(rays, cameras, 2 * options.last_scale_fraction * max_side_px(cameras));
}

absl::StatusOr<SilhouetteRefineResult> refine_from_silhouettes(const std::vector<Camera>& cameras,
                                                               const SilhouetteSet& silhouettes,
                                                               const SilhouetteRefineOptions& options,
                                                               const SolveProgress& progress) {
    const SilhouetteResiduals residuals(cameras, silhouettes, options);
    const ContourRayCost& rays = residuals.rays();
    if (rays.frame_sets() < kMinRefined)
        return absl::FailedPreconditionError(
            fmt::format("two cameras see the person in {} frame sets, at least {} are needed; let a "
                        "person walk where all cameras see them",
                        rays.frame_sets(), kMinRefined));
    const double side = max_side_px(cameras);
    const double first = options.first_scale_fraction * side, last = options.last_scale_fraction * side;
    SilhouetteRefineResult result;
    result.cameras = cameras;
    result.residual_before_px = mean_residual(rays, cameras, 2 * last);
    double damping = kDamping;
    int stuck = 0;
    const double spread = spread_of(cameras);
    for (int round = 0; round < options.rounds; ++round) {
        if (progress && !progress(static_cast<double>(round) / options.rounds,
                                  fmt::format("silhouettes, round {}", round + 1)))
            return absl::CancelledError("stopped; nothing was changed");
        const double fraction = std::min(1.0, 1.5 * round / options.rounds);
        const double scale = first * std::pow(last / first, fraction);
        PoseNormalEquations normal = residuals.measure(result.cameras, scale, true);
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
            if (step.allFinite() && residuals.measure(tried, scale, false).cost < normal.cost) {
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
        if (fraction >= 1 && stuck >= 2) break;
    }
    align_to(cameras, result.cameras);
    result.residual_after_px = mean_residual(rays, result.cameras, 2 * last);
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        result.rotated_deg.push_back(degrees(angle_between(cameras[c].camera_from_world.rotation,
                                                           result.cameras[c].camera_from_world.rotation)));
        result.moved_m.push_back(norm(cameras[c].centre_in_world() - result.cameras[c].centre_in_world()));
    }
    return result;
}

absl::StatusOr<std::optional<ExtrinsicsUncertainty>> split_half_uncertainty(
    const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes, SilhouetteRefineOptions options,
    const SolveProgress& progress) {
    const std::size_t all = silhouettes.frame_sets.size();
    options.max_frame_sets = (options.max_frame_sets + 1) / 2;
    options.rounds = (options.rounds + 1) / 2;
    std::vector<Camera> halves[2];
    for (const std::size_t half : {0, 1}) {
        SilhouetteSet some;
        some.frame_sets.assign(
            silhouettes.frame_sets.begin() + static_cast<std::ptrdiff_t>(half * all / 2),
            silhouettes.frame_sets.begin() + static_cast<std::ptrdiff_t>((half + 1) * all / 2));
        const auto refined = refine_from_silhouettes(cameras, some, options, progress);
        if (absl::IsCancelled(refined.status())) return refined.status();
        if (!refined.ok()) return std::optional<ExtrinsicsUncertainty>();
        halves[half] = refined->cameras;
    }
    std::vector<Vec3> from, to;
    for (std::size_t c = 0; c < cameras.size(); ++c)
        from.push_back(halves[0][c].centre_in_world()), to.push_back(halves[1][c].centre_in_world());
    const auto alignment = align_points(from, to, cameras.size() > 2);
    if (!alignment) return std::optional<ExtrinsicsUncertainty>();
    move_cameras(*alignment, halves[0]);
    ExtrinsicsUncertainty worst;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        worst.centre_mm = std::max(worst.centre_mm, 1000 * norm(halves[0][c].centre_in_world() - to[c]));
        worst.rotation_deg =
            std::max(worst.rotation_deg, degrees(angle_between(halves[0][c].camera_from_world.rotation,
                                                               halves[1][c].camera_from_world.rotation)));
    }
    return std::optional(worst);
}

}  // namespace kinevox
