// The lamps of the studio. One key lamp casts the visible shadow; panels and reflected light fill in. Light
// is relative to that at the centre of the floor.
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "server/cameras/studio/vec3f.h"

namespace kinevox::studio {

struct Lamp {
    Vec3f position;            // world, m
    Vec3f power;               // m^2: light at 1 m straight below
    float half_size_m = 0.1f;  // a square of twice this, horizontal
    bool downlight = true;     // gives cos of the angle to the vertical; else the same in all directions
};

struct Lighting {
    Lamp key;
    std::vector<Lamp> panels;
    Vec3f from_above, from_below;  // ambient light on a surface that faces up, down

    // Light of one lamp on a surface at p with this normal, nothing in between.
    static Vec3f direct(const Lamp& lamp, Vec3f p, Vec3f normal) {
        const Vec3f way = lamp.position - p;
        const float d2 = std::max(dot(way, way), 0.01f), inv = 1.0f / std::sqrt(d2);
        const float cosine = dot(normal, way) * inv;
        if (cosine <= 0) return {};
        const float emission = lamp.downlight ? std::max(way.z * inv, 0.0f) : 1.0f;
        return cosine * emission / d2 * lamp.power;
    }
    Vec3f ambient(Vec3f normal) const {
        const float up = 0.5f + 0.5f * normal.z;
        return up * from_above + (1 - up) * from_below;
    }
};

}  // namespace kinevox::studio
