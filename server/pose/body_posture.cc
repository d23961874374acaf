// Coordinates and postures: rotations to named angles and back.
#include <algorithm>
#include <cmath>
#include <limits>

#include "common/geometry.h"
#include "server/pose/body_model.h"

namespace kinevox {
namespace {

// +1 for the right side and the centre, -1 for the left: adduction and internal rotation are mirrored.
double mirror(int segment) {
    return kSegmentSide[segment] == BodySide::kLeft ? -1.0 : 1.0;
}

Mat3 about(Vec3 axis, double angle) {
    return rotation_from_rodrigues(angle * axis);
}

// Axes of the three angles, in the order of the coordinates (flexion or tilt, adduction or obliquity,
// rotation), each in the frame in which it is fixed.
struct BallAxes {
    Vec3 flexion, adduction, rotation;
};
BallAxes ball_axes(int segment) {
    return {{0, -1, 0}, {mirror(segment), 0, 0}, {0, 0, mirror(segment)}};
}

Mat3 ball_rotation(int segment, const double* angles) {
    const BallAxes axes = ball_axes(segment);
    const Mat3 flexion = about(axes.flexion, angles[0]), adduction = about(axes.adduction, angles[1]),
               rotation = about(axes.rotation, angles[2]);
    return segment == kPelvis ? rotation * adduction * flexion : flexion * adduction * rotation;
}

// R = F(-y) A(x) T(z) with the signs of the axes taken out: F = Ry(-f), A = Rx(m a), T = Rz(m t).
void ball_angles(int segment, const Mat3& r, double* angles) {
    const double m = mirror(segment);
    constexpr double kSingular = 1 - 1e-9;
    if (segment == kPelvis) {  // Rz(t) Rx(a) Ry(f)
        const double sin_a = std::clamp(r(2, 1), -1.0, 1.0);
        const bool singular = std::abs(sin_a) > kSingular;
        angles[1] = std::asin(sin_a);
        const double f = singular ? std::atan2(r(0, 2), r(0, 0)) : std::atan2(-r(2, 0), r(2, 2));
        const double t = singular ? 0 : std::atan2(-r(0, 1), r(1, 1));
        angles[0] = -f;
        angles[2] = t;
        return;
    }
    const double sin_a = std::clamp(-r(1, 2), -1.0, 1.0);  // Ry(f) Rx(a) Rz(t)
    const bool singular = std::abs(sin_a) > kSingular;
    const double f = singular ? std::atan2(-r(2, 0), r(0, 0)) : std::atan2(r(0, 2), r(2, 2));
    const double t = singular ? 0 : std::atan2(r(1, 0), r(1, 1));
    angles[0] = -f;
    angles[1] = m * std::asin(sin_a);
    angles[2] = m * t;
}

double hinge_angle(int segment, const Mat3& r) {
    const Vec3 axis = hinge_axis(segment);
    const Vec3 twice_sine{r(2, 1) - r(1, 2), r(0, 2) - r(2, 0), r(1, 0) - r(0, 1)};
    return std::atan2(dot(twice_sine, axis), r(0, 0) + r(1, 1) + r(2, 2) - 1);
}

}  // namespace

Vec3 hinge_axis(int segment) {
    const std::array<int, 3>& axis = kSegmentHingeAxis[segment];
    return {static_cast<double>(axis[0]), static_cast<double>(axis[1]), static_cast<double>(axis[2])};
}

BodyPosture posture_from_coordinates(const BodyCoordinates& q) {
    BodyPosture posture;
    posture.root_in_world = {q[0], q[1], q[2]};
    for (int s = 0; s < kBodySegmentCount; ++s) {
        const double* angles = q.data() + kSegmentDof[s];
        posture.parent_from_segment[s] =
            kSegmentDofCount[s] == 3 ? ball_rotation(s, angles) : about(hinge_axis(s), angles[0]);
    }
    return posture;
}

BodyCoordinates coordinates_from_posture(const BodyPosture& posture) {
    BodyCoordinates q{};
    q[0] = posture.root_in_world.x, q[1] = posture.root_in_world.y, q[2] = posture.root_in_world.z;
    for (int s = 0; s < kBodySegmentCount; ++s) read_coordinates(posture, s, q);
    return q;
}

void read_coordinates(const BodyPosture& posture, int segment, BodyCoordinates& coordinates) {
    double* const angles = coordinates.data() + kSegmentDof[segment];
    if (kSegmentDofCount[segment] == 3)
        ball_angles(segment, posture.parent_from_segment[segment], angles);
    else
        angles[0] = hinge_angle(segment, posture.parent_from_segment[segment]);
}

BodyPosture stepped(const BodyPosture& posture, std::span<const double, kBodyDofCount> step) {
    BodyPosture next;
    next.root_in_world = posture.root_in_world + Vec3{step[0], step[1], step[2]};
    for (int s = 0; s < kBodySegmentCount; ++s) {
        const double* d = step.data() + kSegmentDof[s];
        const Vec3 turn = kSegmentDofCount[s] == 3 ? Vec3{d[0], d[1], d[2]} : d[0] * hinge_axis(s);
        next.parent_from_segment[s] = rotation_from_rodrigues(turn) * posture.parent_from_segment[s];
    }
    return next;
}

BodyStep step_between(const BodyPosture& a, const BodyPosture& b) {
    BodyStep step{};
    const Vec3 moved = b.root_in_world - a.root_in_world;
    step[0] = moved.x, step[1] = moved.y, step[2] = moved.z;
    for (int s = 0; s < kBodySegmentCount; ++s) {
        const Vec3 turn =
            rodrigues_from_rotation(b.parent_from_segment[s] * a.parent_from_segment[s].transposed());
        double* d = step.data() + kSegmentDof[s];
        if (kSegmentDofCount[s] == 3)
            d[0] = turn.x, d[1] = turn.y, d[2] = turn.z;
        else
            d[0] = dot(turn, hinge_axis(s));
    }
    return step;
}

BodyPosture between(const BodyPosture& a, const BodyPosture& b, double fraction) {
    BodyStep step = step_between(a, b);
    for (double& s : step) s *= fraction;
    return stepped(a, step);
}

Mat3 euler_rates(int segment, const Mat3& r) {
    BodyCoordinates q{};
    double* angles = q.data();
    ball_angles(segment, r, angles);
    const BallAxes axes = ball_axes(segment);
    // Axes of the three angles' rates in the parent's frame.
    Vec3 f, a, t;
    if (segment == kPelvis) {
        t = axes.rotation;
        a = about(axes.rotation, angles[2]) * axes.adduction;
        f = about(axes.rotation, angles[2]) * (about(axes.adduction, angles[1]) * axes.flexion);
    } else {
        f = axes.flexion;
        a = about(axes.flexion, angles[0]) * axes.adduction;
        t = about(axes.flexion, angles[0]) * (about(axes.adduction, angles[1]) * axes.rotation);
    }
    // Rows of the inverse of [f a t]: cross products over the determinant, cos(adduction) up to its sign.
    const double det = dot(f, cross(a, t));
    constexpr double kMinCosine = 0.1;
    const double inverse = 1 / std::copysign(std::max(std::abs(det), kMinCosine), det);
    const Vec3 rows[3] = {inverse * cross(a, t), inverse * cross(t, f), inverse * cross(f, a)};
    Mat3 rates;
    for (int k = 0; k < 3; ++k) rates(k, 0) = rows[k].x, rates(k, 1) = rows[k].y, rates(k, 2) = rows[k].z;
    return rates;
}

}  // namespace kinevox
