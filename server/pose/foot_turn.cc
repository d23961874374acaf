#include "server/pose/foot_turn.h"

#include <algorithm>
#include <cmath>

#include "common/geometry.h"

namespace kinevox {
namespace {

constexpr double kTurnStd = 12 * kDegree, kMaxTurn = 35 * kDegree;

// Derivatives of half the cost by a foot's turn.
struct Slope {
    double first = 0, second = 0;
};

Slope slope_of(const PoseCost& cost, int foot) {
    const PosedBody& posed = cost.posed();
    const Rigid3& world_from_foot = posed.world_from_segment[foot];
    const Vec3 axis = world_from_foot.rotation * Vec3{0, 0, 1}, ankle = world_from_foot.translation;
    Slope slope;
    for (const SurfaceTerm& term : cost.terms()) {
        if (cost.capsules()[term.capsule].segment != foot) continue;
        const double by_turn = dot(axis, cross(term.point_in_world - ankle, term.gradient));
        slope.first += term.weight * term.residual * by_turn;
        slope.second += term.weight * by_turn * by_turn;
    }
    return slope;
}

}  // namespace

double foot_turn(const BodyPosture& posture, int foot) {
    const Mat3& r = posture.parent_from_segment[foot];  // Ry(hinge) Rz(turn)
    return std::atan2(r(1, 0), r(1, 1));
}

void add_foot_turn(double turn, int foot, BodyPosture& posture) {
    Mat3& parent_from_foot = posture.parent_from_segment[foot];
    parent_from_foot = parent_from_foot * rotation_z(turn);
}

void turn_feet(const BodyModel& model, std::span<const SilhouetteRays> views, double robust_m, int steps,
               PoseCost& cost, BodyPosture& posture) {
    for (int n = 0; n < steps; ++n) {
        cost.cost_of(model, posture, views, robust_m);
        for (const int foot : {kFootL, kFootR}) {
            const Slope slope = slope_of(cost, foot);
            const double turn = foot_turn(posture, foot), weight = 1 / (kTurnStd * kTurnStd);
            const double step = -(slope.first + weight * turn) / (slope.second + weight);
            const double next = std::clamp(turn + step, -kMaxTurn, kMaxTurn);
            add_foot_turn(next - turn, foot, posture);
        }
    }
}

}  // namespace kinevox
