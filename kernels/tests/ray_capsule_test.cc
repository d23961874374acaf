// The nearest capsule of each ray, against the same question asked of every capsule in double precision.
#include "kernels/ray_capsule.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <vector>

namespace kinevox::kernels {
namespace {

struct Rays {
    std::vector<float> direction[3], outward[3];
    RayBundle bundle(const float* origin) const {
        RayBundle b;
        for (int k = 0; k < 3; ++k) {
            b.origin[k] = origin[k];
            b.direction[k] = direction[k].data(), b.outward[k] = outward[k].data();
        }
        b.count = static_cast<int>(direction[0].size());
        return b;
    }
};

// Towards points near the capsules; outward at random.
Rays rays_at(const std::vector<TaperedCapsule>& body, const float* origin, int count, std::mt19937& random) {
    std::normal_distribution<double> spread(0, 0.1);
    Rays rays;
    for (int n = 0; n < count; ++n) {
        const TaperedCapsule& at = body[n * body.size() / static_cast<std::size_t>(count)];
        double d[3], o[3], length = 0, along = 0, out = 0;
        for (int k = 0; k < 3; ++k) d[k] = at.a[k] + spread(random) - origin[k], length += d[k] * d[k];
        for (int k = 0; k < 3; ++k) d[k] /= std::sqrt(length), o[k] = spread(random), along += o[k] * d[k];
        for (int k = 0; k < 3; ++k) o[k] -= along * d[k], out += o[k] * o[k];
        for (int k = 0; k < 3; ++k) {
            rays.direction[k].push_back(static_cast<float>(d[k]));
            rays.outward[k].push_back(static_cast<float>(o[k] / std::sqrt(out)));
        }
    }
    return rays;
}

// The least signed distance over points along the axis, and whether the axis there is on the outer side.
double distance_along(const Rays& rays, int n, const float* origin, const TaperedCapsule& c) {
    double best = 1e9, side = 0;
    for (int step = 0; step <= 1000; ++step) {
        const double t = step / 1000.0;
        double w[3], along = 0, out = 0, length2 = 0;
        for (int k = 0; k < 3; ++k) {
            w[k] = (1 - t) * c.a[k] + t * c.b[k] - origin[k];
            along += w[k] * rays.direction[k][n];
            out += w[k] * rays.outward[k][n];
        }
        for (int k = 0; k < 3; ++k) length2 += std::pow(w[k] - along * rays.direction[k][n], 2);
        const double d = std::sqrt(length2) - ((1 - t) * c.radius_a + t * c.radius_b);
        if (d < best) best = d, side = out;
    }
    return best > 0 && side > 0 ? kWrongSide_m : best;
}

std::vector<TaperedCapsule> some_body(std::mt19937& random, int count) {
    std::uniform_real_distribution<float> place(-0.5f, 0.5f), radius(0.03f, 0.12f);
    std::vector<TaperedCapsule> body(count);
    for (TaperedCapsule& c : body) {
        for (int k = 0; k < 3; ++k) c.a[k] = place(random), c.b[k] = c.a[k] + 0.6f * place(random);
        c.radius_a = radius(random), c.radius_b = radius(random);
    }
    return body;
}

TEST(NearestCapsules, EqualExhaustiveSearch) {
    std::mt19937 random(7);
    const float origin[3] = {4, -3, 1.5f};
    const auto body = some_body(random, 23);
    const Rays rays = rays_at(body, origin, 333, random);  // no whole number of blocks
    std::vector<float> distance(333);
    std::vector<int> nearest(333);
    nearest_capsules(rays.bundle(origin), body, distance.data(), nearest.data());
    int through = 0, none = 0;
    for (int n = 0; n < 333; ++n) {
        double least = 1e9;
        for (const TaperedCapsule& c : body) least = std::min(least, distance_along(rays, n, origin, c));
        // The sign is arbitrary at a point where the side changes.
        EXPECT_NEAR(distance[n], least, 2e-3) << "ray " << n;
        if (nearest[n] >= 0) {
            EXPECT_NEAR(distance_along(rays, n, origin, body[nearest[n]]), least, 2e-3) << "ray " << n;
        }
        through += distance[n] < 0, none += nearest[n] < 0;
    }
    EXPECT_GT(through, 100);
    EXPECT_GT(none, 5);
    EXPECT_GT(333 - through - none, 20) << "some pass beside on the inner side";
}

// Each ray's answer is its own: it does not depend on which rays share its block.
TEST(NearestCapsules, AreIndependentOfNeighbouringRays) {
    std::mt19937 random(11);
    const float origin[3] = {0, 5, 1};
    const auto body = some_body(random, 30);
    const Rays rays = rays_at(body, origin, 200, random);
    std::vector<float> all(200), one(1);
    std::vector<int> of_all(200), of_one(1);
    nearest_capsules(rays.bundle(origin), body, all.data(), of_all.data());
    for (int n = 0; n < 200; ++n) {
        RayBundle single = rays.bundle(origin);
        for (int k = 0; k < 3; ++k) single.direction[k] += n, single.outward[k] += n;
        single.count = 1;
        nearest_capsules(single, body, one.data(), of_one.data());
        EXPECT_EQ(one[0], all[n]) << n;
        EXPECT_EQ(of_one[0], of_all[n]) << n;
    }
}

TEST(NearerCapsules, AndThoseOfTheRestEqualTheNearestOfAll) {
    std::mt19937 random(13);
    const float origin[3] = {4, -3, 1.5f};
    const auto body = some_body(random, 30);
    const std::span all(body), rest = all.first(25), moved = all.subspan(25);
    const Rays rays = rays_at(body, origin, 333, random);
    std::vector<float> distance(333), expected(333);
    std::vector<int> of_rest(333), of_moved(333), of_all(333);
    nearest_capsules(rays.bundle(origin), all, expected.data(), of_all.data());
    nearest_capsules(rays.bundle(origin), rest, distance.data(), of_rest.data());
    nearer_capsules(rays.bundle(origin), moved, distance.data(), of_moved.data());
    int nearer = 0;
    for (int n = 0; n < 333; ++n) {
        EXPECT_EQ(of_moved[n] < 0 ? of_rest[n] : 25 + of_moved[n], of_all[n]) << n;
        EXPECT_EQ(distance[n], expected[n]) << n;
        nearer += of_moved[n] >= 0;
    }
    EXPECT_GT(nearer, 20);
    EXPECT_LT(nearer, 200);
    EXPECT_THROW(nearer_capsules(rays.bundle(origin), some_body(random, kMaxCapsules + 1), distance.data(),
                                 of_moved.data()),
                 std::invalid_argument);
}

TEST(NearestCapsules, AreNoneWithoutBody) {
    std::mt19937 random(3);
    const float origin[3] = {0, 5, 1};
    const auto body = some_body(random, kMaxCapsules + 1);
    const Rays rays = rays_at(body, origin, 20, random);
    std::vector<float> distance(20);
    std::vector<int> nearest(20);
    nearest_capsules(rays.bundle(origin), {}, distance.data(), nearest.data());
    EXPECT_EQ(nearest, std::vector<int>(20, -1));
    EXPECT_EQ(distance, std::vector<float>(20, kWrongSide_m));
    EXPECT_THROW(nearest_capsules(rays.bundle(origin), body, distance.data(), nearest.data()),
                 std::invalid_argument);
}

// Each surface lies where the distance says: from there the ray passes at the radius.
TEST(TouchCapsules, FindThePointOfEachRaysOwnCapsule) {
    constexpr int kRays = 205;  // no whole number of vectors
    std::mt19937 random(13);
    const float origin[3] = {4, -3, 1.5f};
    const double exact[3] = {origin[0], origin[1], origin[2]};
    const auto body = some_body(random, 30);
    const Rays rays = rays_at(body, origin, kRays, random);
    std::vector<int> which(kRays);
    for (int n = 0; n < kRays; ++n) which[n] = n * 30 / kRays;  // as rays_at() aims
    std::vector<double> distance(kRays), along(kRays), gradient[3];
    for (auto& g : gradient) g.resize(kRays);
    touch_capsules(
        rays.bundle(origin), exact, body, which.data(),
        {distance.data(), along.data(), {gradient[0].data(), gradient[1].data(), gradient[2].data()}});
    int beside = 0, through = 0, across = 0;
    for (int n = 0; n < kRays; ++n) {
        const TaperedCapsule& c = body[which[n]];
        double from_ray[3], depth = 0, length2 = 0, dot = 0;
        for (int k = 0; k < 3; ++k) {
            from_ray[k] = (1 - along[n]) * c.a[k] + along[n] * c.b[k] - origin[k];
            depth += from_ray[k] * rays.direction[k][n];
        }
        for (int k = 0; k < 3; ++k) {
            from_ray[k] -= depth * rays.direction[k][n];
            length2 += from_ray[k] * from_ray[k], dot += from_ray[k] * gradient[k][n];
        }
        const double length = std::sqrt(length2),
                     radius = (1 - along[n]) * c.radius_a + along[n] * c.radius_b;
        // To the other side of a thin capsule beyond the border, as if the axis were nearer by both radii.
        const double side = dot < 0 ? -1 : 1;
        EXPECT_NEAR(dot, side * length, 1e-6) << n;
        EXPECT_NEAR(distance[n], side * length - radius, 1e-6) << n;
        if (side < 0) {
            EXPECT_LT(length + radius, 0.09 + 1e-6) << n;
            ++across;
        } else {
            ++(distance[n] < 0 ? through : beside);
        }
    }
    EXPECT_GT(beside, 20);
    EXPECT_GT(through, 20);
    EXPECT_GT(across, 1);
    EXPECT_THROW(
        touch_capsules(rays.bundle(origin), exact, some_body(random, kMaxCapsules + 1), which.data(), {}),
        std::invalid_argument);
}

}  // namespace
}  // namespace kinevox::kernels
