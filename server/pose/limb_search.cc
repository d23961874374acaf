#include "server/pose/limb_search.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

namespace kinevox {
namespace {

constexpr int kDirections = 64;  // on the sphere; those outside a joint's range are skipped
constexpr int kTwists = 6;
constexpr double kBends[] = {0.2, 1.1, 2.0};  // of elbow and knee, rad
constexpr double kFineBends[] = {0.2, 0.7, 1.2, 1.7, 2.2};
constexpr int kFineTwists = 8;
constexpr std::size_t kRayStep = 3;  // stride: a subset of the rays suffices for the choice
constexpr double kStraight = 0.3;    // rad; below it the rotation of a straight limb has no effect
constexpr double kRaysGained = 1.5;  // minimum number of additionally explained rays of the subset
// A coarse configuration of a pair is compared with a fitted one, so it may be worse by this many rays before
// it is fitted.
constexpr double kPairSlack = 2;
constexpr double kUnlimited = std::numeric_limits<double>::infinity();

// Evenly over the sphere (a Fibonacci lattice).
Vec3 direction(int k) {
    const double z = 1 - (2 * k + 1.0) / kDirections, r = std::sqrt(1 - z * z);
    const double turn = k * std::numbers::pi * (3 - std::sqrt(5.0));
    return {r * std::cos(turn), r * std::sin(turn), z};
}

bool reachable(const LimbSegments& limb, Vec3 u) {
    const double outwards = limb.left ? u.y : -u.y;
    if (limb.arm) return u.x > -0.75 && outwards > -0.6 && !(u.z > 0.3 && u.x < -0.5);
    return u.z < 0.45 && u.x > -0.6 && outwards > -0.4 && outwards < 0.85;
}

// Rotates the hanging limb to a direction along the shortest arc, after a twist about its own axis.
Mat3 towards(Vec3 u, double twist) {
    const Vec3 down{0, 0, -1};
    const Vec3 axis = cross(down, u);
    const double sine = norm(axis), angle = std::atan2(sine, dot(down, u));
    const Mat3 swing = sine < 1e-9 ? (angle < 1 ? Mat3{} : rotation_x(std::numbers::pi))
                                   : rotation_from_rodrigues((angle / sine) * axis);
    return swing * rotation_z(twist);
}

double kernel(double residual, double robust_m) {
    const double r2 = residual * residual;
    return r2 / (1 + r2 / (robust_m * robust_m));
}

}  // namespace

LimbSegments segments_of(Limb limb) {
    switch (limb) {
        case Limb::kArmL:
            return {kUpperArmL, kForearmL, kHandL, true, true};
        case Limb::kArmR:
            return {kUpperArmR, kForearmR, kHandR, true, false};
        case Limb::kLegL:
            return {kThighL, kShankL, kFootL, false, true};
        case Limb::kLegR:
            break;
    }
    return {kThighR, kShankR, kFootR, false, false};
}

void LimbSearch::thin_out(std::span<const SilhouetteRays> views) {
    rays_.resize(views.size());
    for (std::size_t c = 0; c < views.size(); ++c) {
        const ContourRays& all = views[c].contour;
        ContourRays& some = rays_[c];
        some.origin_in_world = all.origin_in_world;
        for (int axis = 0; axis < 3; ++axis) {
            some.direction[axis].clear(), some.outward[axis].clear();
            if (!views[c].camera) continue;
            for (std::size_t i = 0; i < all.size(); i += kRayStep) {
                some.direction[axis].push_back(all.direction[axis][i]);
                some.outward[axis].push_back(all.outward[axis][i]);
            }
        }
    }
}

// The cheap terms first: most configurations of a limb leave the silhouettes.
double LimbSearch::cost(std::span<const SilhouetteRays> views, std::span<const BodyCapsule> capsules,
                        double robust_m, double limit) {
    double sum = 0;
    for (const SilhouetteRays& view : views) {
        if (!view.camera) continue;
        for (const BodyCapsule& capsule : capsules)
            for (const double along : {0.2, 0.8}) {
                const Vec3 a{capsule.a[0], capsule.a[1], capsule.a[2]},
                    b{capsule.b[0], capsule.b[1], capsule.b[2]};
                const Vec3 p = (1 - along) * a + along * b;
                const std::optional<double> inside_m = view.inside_m(p);
                if (!inside_m) continue;
                const double out = (1 - along) * capsule.radius_a + along * capsule.radius_b - *inside_m;
                if (out > 0) sum += kernel(out, robust_m);
            }
        if (sum >= limit) return sum;
    }
    for (std::size_t c = 0; c < views.size(); ++c) {
        if (!views[c].camera) continue;
        nearest_capsules(rays_[c], capsules, distance_, which_);
        for (std::size_t i = 0; i < distance_.size(); ++i)
            sum += kernel(std::min(distance_[i], rest_distance_[c][i]), robust_m);
        if (sum >= limit) return sum;
    }
    return sum;
}

// Writes the capsules of the limbs in a posture to capsules_ and, if not null, all others to `others`.
void LimbSearch::split(const BodyModel& model, const BodyPosture& posture, std::span<const Limb> limbs,
                       std::vector<BodyCapsule>* others) {
    const auto belongs = [&](const BodyCapsule& c) {
        return std::any_of(limbs.begin(), limbs.end(), [&](Limb limb) {
            const LimbSegments own = segments_of(limb);
            return c.segment == own.upper || c.segment == own.lower || c.segment == own.end;
        });
    };
    model.capsules(model.forward(posture), capsules_);
    if (others) {
        others->clear();
        std::copy_if(capsules_.begin(), capsules_.end(), std::back_inserter(*others),
                     [&](const BodyCapsule& c) { return !belongs(c); });
    }
    std::erase_if(capsules_, [&](const BodyCapsule& c) { return !belongs(c); });
}

void LimbSearch::set_rest(std::span<const SilhouetteRays> views, std::span<const BodyCapsule> rest) {
    rest_distance_.resize(views.size());
    for (std::size_t c = 0; c < views.size(); ++c)
        if (views[c].camera) nearest_capsules(rays_[c], rest, rest_distance_[c], which_);
}

// The configuration of a limb with the lowest cost below `best`, which it updates.
std::optional<BodyPosture> LimbSearch::cheapest(const BodyModel& model, const BodyPosture& posture,
                                                std::span<const SilhouetteRays> views, Limb which,
                                                LimbSearchScope scope, double robust_m, double& best) {
    const LimbSegments limb = segments_of(which);
    std::optional<BodyPosture> found;
    BodyPosture trial = posture;
    trial.parent_from_segment[limb.end] = Mat3{};
    const auto try_twists = [&](Vec3 u, double bend, int twists, int of) {
        trial.parent_from_segment[limb.lower] = rotation_from_rodrigues(bend * hinge_axis(limb.lower));
        for (int t = 0; t < twists; ++t) {
            const double twist = 2 * std::numbers::pi * (limb.arm ? t : t - (twists - 1) / 2.0) / of;
            trial.parent_from_segment[limb.upper] = towards(u, twist);
            split(model, trial, {&which, 1}, nullptr);
            const double there = cost(views, capsules_, robust_m, best);
            if (there >= best) continue;
            best = there;
            found = trial;
        }
    };
    if (scope == LimbSearchScope::kLower) {
        const Vec3 u = posture.parent_from_segment[limb.upper] * Vec3{0, 0, -1};
        for (const double bend : kFineBends)
            try_twists(u, bend, limb.arm ? kFineTwists : 3, limb.arm ? kFineTwists : 12);
        return found;
    }
    for (int k = 0; k < kDirections; ++k) {
        const Vec3 u = direction(k);
        if (!reachable(limb, u)) continue;
        // A thigh rotates little about its axis, an upper arm much.
        for (const double bend : kBends)
            try_twists(u, bend, bend < kStraight || !limb.arm ? 1 : kTwists, kTwists);
    }
    return found;
}

std::optional<BodyPosture> LimbSearch::improve(const BodyModel& model, const BodyPosture& posture,
                                               std::span<const SilhouetteRays> views, Limb which,
                                               LimbSearchScope scope, double robust_m) {
    std::vector<BodyCapsule> rest;
    split(model, posture, {&which, 1}, &rest);
    thin_out(views);
    set_rest(views, rest);
    double best = cost(views, capsules_, robust_m, kUnlimited) - kRaysGained * robust_m * robust_m;
    return cheapest(model, posture, views, which, scope, robust_m, best);
}

std::optional<BodyPosture> LimbSearch::improve_pair(const BodyModel& model, const BodyPosture& posture,
                                                    std::span<const SilhouetteRays> views, Limb first,
                                                    Limb second, double robust_m) {
    const Limb both[] = {first, second};
    std::vector<BodyCapsule> rest;
    split(model, posture, both, &rest);
    thin_out(views);
    set_rest(views, rest);
    const double now = cost(views, capsules_, robust_m, kUnlimited);
    double best = kUnlimited;
    const auto one = cheapest(model, posture, views, first, LimbSearchScope::kWhole, robust_m, best);
    if (!one) return std::nullopt;
    split(model, *one, {&second, 1}, &rest);
    set_rest(views, rest);
    best = now + kPairSlack * robust_m * robust_m;
    return cheapest(model, *one, views, second, LimbSearchScope::kWhole, robust_m, best);
}

}  // namespace kinevox
