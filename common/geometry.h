// Small vectors, rotations and rigid transforms, plain so that headers stay light (Eigen works inside .cc
// files). A transform is named target_from_source: x_target = target_from_source * x_source.
#pragma once

#include <array>
#include <cmath>
#include <numbers>

namespace kinevox {

// Angles are radians inside and degrees at the edges.
constexpr double degrees(double rad) {
    return rad * 180 / std::numbers::pi;
}
constexpr double radians(double deg) {
    return deg * std::numbers::pi / 180;
}
inline constexpr double kDegree = radians(1);

struct Vec2 {
    double x = 0, y = 0;
    bool operator==(const Vec2&) const = default;
};

struct Vec3 {
    double x = 0, y = 0, z = 0;

    friend Vec3 operator+(Vec3 a, Vec3 b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
    friend Vec3 operator-(Vec3 a, Vec3 b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
    friend Vec3 operator-(Vec3 a) { return {-a.x, -a.y, -a.z}; }
    friend Vec3 operator*(double s, Vec3 a) { return {s * a.x, s * a.y, s * a.z}; }
    friend Vec3 operator*(Vec3 a, double s) { return s * a; }
    friend Vec3 operator/(Vec3 a, double s) { return (1.0 / s) * a; }
    Vec3& operator+=(Vec3 b) { return *this = *this + b; }
    bool operator==(const Vec3&) const = default;
};

inline double dot(Vec3 a, Vec3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline Vec3 cross(Vec3 a, Vec3 b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline double norm(Vec3 a) {
    return std::sqrt(dot(a, a));
}
inline Vec3 normalized(Vec3 a) {
    return a / norm(a);
}

// Row major 3 x 3.
struct Mat3 {
    std::array<double, 9> m{1, 0, 0, 0, 1, 0, 0, 0, 1};

    double operator()(int row, int col) const { return m[3 * row + col]; }
    double& operator()(int row, int col) { return m[3 * row + col]; }
    friend Vec3 operator*(const Mat3& a, Vec3 v) {
        return {a.m[0] * v.x + a.m[1] * v.y + a.m[2] * v.z, a.m[3] * v.x + a.m[4] * v.y + a.m[5] * v.z,
                a.m[6] * v.x + a.m[7] * v.y + a.m[8] * v.z};
    }
    friend Mat3 operator*(const Mat3& a, const Mat3& b) {
        Mat3 c;
        for (int r = 0; r < 3; ++r)
            for (int k = 0; k < 3; ++k) c(r, k) = a(r, 0) * b(0, k) + a(r, 1) * b(1, k) + a(r, 2) * b(2, k);
        return c;
    }
    Mat3 transposed() const { return {{m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]}}; }
    bool operator==(const Mat3&) const = default;
};

// Rodrigues vector (axis times angle, radians) to rotation matrix and back (angle in [0, pi]).
Mat3 rotation_from_rodrigues(Vec3 rotation_vector);
Vec3 rodrigues_from_rotation(const Mat3& rotation);

// A rotation about one of the axes, radians, right-handed.
Mat3 rotation_x(double angle);
Mat3 rotation_y(double angle);
Mat3 rotation_z(double angle);

// x_target = rotation * x_source + translation.
struct Rigid3 {
    Mat3 rotation;
    Vec3 translation;

    friend Vec3 operator*(const Rigid3& t, Vec3 x) { return t.rotation * x + t.translation; }
    friend Rigid3 operator*(const Rigid3& a, const Rigid3& b) {
        return {a.rotation * b.rotation, a.rotation * b.translation + a.translation};
    }
    Rigid3 inverse() const {
        const Mat3 back = rotation.transposed();
        return {back, -(back * translation)};
    }
    bool operator==(const Rigid3&) const = default;
};

}  // namespace kinevox
