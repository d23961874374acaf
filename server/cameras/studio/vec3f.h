// Single precision vectors for the inner loops of the studio.
#pragma once

#include <cmath>

#include "common/geometry.h"

namespace kinevox::studio {

struct Vec3f {
    float x = 0, y = 0, z = 0;

    friend Vec3f operator+(Vec3f a, Vec3f b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
    friend Vec3f operator-(Vec3f a, Vec3f b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
    friend Vec3f operator*(float s, Vec3f a) { return {s * a.x, s * a.y, s * a.z}; }
    friend Vec3f operator*(Vec3f a, Vec3f b) { return {a.x * b.x, a.y * b.y, a.z * b.z}; }
    Vec3f& operator+=(Vec3f b) { return *this = *this + b; }
};
inline float dot(Vec3f a, Vec3f b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}
inline Vec3f cross(Vec3f a, Vec3f b) {
    return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x};
}
inline float norm(Vec3f a) {
    return std::sqrt(dot(a, a));
}
inline Vec3f normalized(Vec3f a) {
    const float n = norm(a);
    return n > 1e-12f ? (1.0f / n) * a : Vec3f{0, 0, 1};
}
inline Vec3f to_float(Vec3 a) {
    return {static_cast<float>(a.x), static_cast<float>(a.y), static_cast<float>(a.z)};
}
inline Vec3 to_double(Vec3f a) {
    return {a.x, a.y, a.z};
}

// x_target = row . (x_source, 1): three rows of four.
struct Affine3f {
    float m[12] = {1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0};

    Vec3f point(Vec3f p) const {
        return {m[0] * p.x + m[1] * p.y + m[2] * p.z + m[3], m[4] * p.x + m[5] * p.y + m[6] * p.z + m[7],
                m[8] * p.x + m[9] * p.y + m[10] * p.z + m[11]};
    }
    Vec3f direction(Vec3f p) const {
        return {m[0] * p.x + m[1] * p.y + m[2] * p.z, m[4] * p.x + m[5] * p.y + m[6] * p.z,
                m[8] * p.x + m[9] * p.y + m[10] * p.z};
    }
};
inline Affine3f to_float(const Rigid3& t) {
    Affine3f out;
    const double offset[3] = {t.translation.x, t.translation.y, t.translation.z};
    for (int r = 0; r < 3; ++r) {
        for (int c = 0; c < 3; ++c) out.m[4 * r + c] = static_cast<float>(t.rotation(r, c));
        out.m[4 * r + 3] = static_cast<float>(offset[r]);
    }
    return out;
}

}  // namespace kinevox::studio
