// Analytic derivatives of the pose cost against numeric ones.
#include "server/pose/pose_cost.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <string>
#include <vector>

#include "common/geometry.h"
#include "server/pose/ray_capsule.h"
#include "tests/support/seen_body.h"

namespace kinevox {
namespace {

constexpr double kOff_m = 1e6;  // a standard deviation that switches a kind of term off

// The standing body, a little off in every degree of freedom, its feet slightly below the floor.
BodyPosture perturbed(const testing::SeenBody& scene, unsigned seed) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<> unit(-1, 1);
    BodyCoordinates q = scene.standing();
    for (int k = 0; k < kBodyDofCount; ++k) q[k] += unit(random) * (is_position(k) ? 0.01 : radians(4));
    q[2] -= 0.02;
    return posture_from_coordinates(q);
}

// Norm of the difference between the gradient and central differences of the cost, over the gradient's norm.
double gradient_error(const PoseCostOptions& options, const testing::SeenBody& scene,
                      const BodyPosture& posture, std::span<const SilhouetteRays> views,
                      const MotionPrior* prior, double step) {
    constexpr double kRobust_m = 0.1;
    PoseCost cost(options);
    Linearisation at, forth, back;
    cost.linearise(*scene.model, posture, views, prior, kRobust_m, at);
    double difference2 = 0;
    for (int k = 0; k < kBodyDofCount; ++k) {
        BodyStep up{}, down{};
        up[k] = step, down[k] = -step;
        cost.linearise(*scene.model, stepped(posture, up), views, prior, kRobust_m, forth);
        cost.linearise(*scene.model, stepped(posture, down), views, prior, kRobust_m, back);
        const double numeric = (forth.cost - back.cost) / (2 * step);
        difference2 += (numeric - at.gradient[k]) * (numeric - at.gradient[k]);
    }
    return std::sqrt(difference2) / at.gradient.norm();
}

TEST(TouchRay, GradientMatchesNumericDifferences) {
    std::mt19937 random(3);
    std::uniform_real_distribution<> unit(-1, 1);
    const auto vector = [&] { return Vec3{unit(random), unit(random), unit(random)}; };
    constexpr double kStep = 1e-6;
    int at_ends = 0, tapered = 0, across_border = 0;
    for (int n = 0; n < 5000; ++n) {
        const Vec3 a = 0.3 * vector(), b = a + 0.4 * vector();
        BodyCapsule capsule;
        for (int k = 0; k < 3; ++k) {
            capsule.a[k] = static_cast<float>(k == 0 ? a.x : k == 1 ? a.y : a.z);
            capsule.b[k] = static_cast<float>(k == 0 ? b.x : k == 1 ? b.y : b.z);
        }
        capsule.radius_a = capsule.radius_b = static_cast<float>(0.02 + 0.05 * std::abs(unit(random)));
        if (n % 2 == 0) capsule.radius_b = static_cast<float>(0.02 + 0.05 * std::abs(unit(random)));
        const Vec3 origin{-4, 0.2 * unit(random), 0.2 * unit(random)};
        const Vec3 direction = normalized(Vec3{4, 0.4 * unit(random), 0.4 * unit(random)});
        const Vec3 outward = normalized(cross(direction, vector()));
        const RayTouch touch = touch_ray(origin, direction, outward, capsule);
        const double taper = capsule.radius_b - capsule.radius_a,
                     radius = capsule.radius_a + taper * touch.along;
        const bool crosses = touch.distance < -radius;
        const double axis_to_ray = std::abs(touch.distance + radius);
        const Vec3 axis = b - a;
        const double projected = norm(axis - dot(axis, direction) * direction);
        // Undefined at the axis; approximate for steep tapers seen end-on and for tapers across the border.
        if (!touch.usable || axis_to_ray < 0.01 || projected < 3 * std::abs(taper)) continue;
        if (crosses && taper != 0) continue;
        at_ends += touch.along == 0 || touch.along == 1;
        tapered += taper != 0 && touch.along > 0 && touch.along < 1;
        across_border += crosses;
        // A movement of the capsule equals the opposite movement of the ray.
        for (const Vec3 along : {Vec3{1, 0, 0}, Vec3{0, 1, 0}, Vec3{0, 0, 1}}) {
            const RayTouch forth = touch_ray(origin - kStep * along, direction, outward, capsule);
            const RayTouch back = touch_ray(origin + kStep * along, direction, outward, capsule);
            const double numeric = (forth.distance - back.distance) / (2 * kStep);
            EXPECT_NEAR(numeric, dot(touch.gradient, along), 1e-5) << n;
        }
    }
    EXPECT_GT(at_ends, 200);
    EXPECT_GT(tapered, 200);
    EXPECT_GT(across_border, 20);
}

TEST(PoseCost, FloorLimitAndPriorGradientsMatchNumericDifferences) {
    const testing::SeenBody scene;
    PoseCostOptions options;
    options.separation_std_m = kOff_m;  // its gradient moves only one of the two bodies
    for (unsigned seed = 0; seed < 3; ++seed) {
        MotionPrior prior;
        prior.expected = posture_from_coordinates(scene.standing());
        prior.std.fill(0.5);
        EXPECT_LT(gradient_error(options, scene, perturbed(scene, seed), {}, &prior, 1e-4), 1e-4) << seed;
    }
}

// The term of each ray, unless it switches to another capsule or to the other side of the border within the
// step.
TEST(PoseCost, ContourGradientMatchesNumericDifferences) {
    const testing::SeenBody scene;
    const auto views = scene.see(scene.standing());
    PoseCostOptions options;
    options.inside_std_m = options.floor_std_m = options.separation_std_m = kOff_m;
    const BodyPosture posture = perturbed(scene, 1);
    constexpr double kStep = 5e-4, kRobust_m = 0.1;
    PoseCost cost(options);
    Linearisation angles_only;  // joint limits and rest pose, which need no view
    cost.linearise(*scene.model, posture, {}, nullptr, kRobust_m, angles_only);
    double difference2 = 0, gradient2 = 0;
    int compared = 0, switched = 0;
    for (const SilhouetteRays& view : views) {
        for (std::size_t i = 0; i < view.contour.size(); i += 8) {
            SilhouetteRays ray;
            ray.camera = view.camera;
            ray.contour.origin_in_world = view.contour.origin_in_world;
            for (int k = 0; k < 3; ++k) {
                ray.contour.direction[k] = {view.contour.direction[k][i]};
                ray.contour.outward[k] = {view.contour.outward[k][i]};
            }
            const std::span<const SilhouetteRays> one(&ray, 1);
            Linearisation at, forth, back;
            const auto term = [&](const BodyPosture& moved, Linearisation& out) {
                cost.linearise(*scene.model, moved, one, nullptr, kRobust_m, out);
                const auto found = std::ranges::find(cost.terms(), -1.0, &SurfaceTerm::radius_gradient);
                SurfaceTerm none;
                none.camera = -1;
                return found == cost.terms().end() ? none : *found;
            };
            const SurfaceTerm here = term(posture, at);
            if (here.camera < 0) continue;
            const BodyCapsule& capsule = cost.capsules()[here.capsule];
            const double radius = capsule.radius_a + here.along * (capsule.radius_b - capsule.radius_a);
            if (here.residual < -radius) continue;  // across the border: approximate, see TouchRay
            for (int k = 0; k < kBodyDofCount; ++k) {
                BodyStep up{}, down{};
                up[k] = kStep, down[k] = -kStep;
                const SurfaceTerm above = term(stepped(posture, up), forth);
                const SurfaceTerm below = term(stepped(posture, down), back);
                const bool same = above.camera == here.camera && below.camera == here.camera &&
                                  above.capsule == here.capsule && below.capsule == here.capsule &&
                                  dot(above.gradient, here.gradient) > 0 &&
                                  dot(below.gradient, here.gradient) > 0;
                ++(same ? compared : switched);
                if (!same) continue;
                const double analytic = at.gradient[k] - angles_only.gradient[k];
                const double numeric =
                    here.weight * here.residual * (above.residual - below.residual) / (2 * kStep);
                difference2 += (numeric - analytic) * (numeric - analytic);
                gradient2 += analytic * analytic;
            }
        }
    }
    const double error = std::sqrt(difference2 / gradient2);
    RecordProperty("relative_error", std::to_string(error));
    EXPECT_LT(error, 1e-3);
    EXPECT_LT(switched, compared / 20);
    EXPECT_GT(compared, 1000);
}

// Inside terms neglect distortion, movement along the depth and the curvature of the distance map.
TEST(PoseCost, InsideGradientMatchesNumericDifferences) {
    const testing::SeenBody scene;
    const auto views = scene.see(scene.standing());
    PoseCostOptions options;
    options.contour_std_m = options.floor_std_m = options.separation_std_m = kOff_m;
    for (unsigned seed = 0; seed < 3; ++seed)
        EXPECT_LT(gradient_error(options, scene, perturbed(scene, seed), views, nullptr, 1e-4), 0.01) << seed;
}

}  // namespace
}  // namespace kinevox
