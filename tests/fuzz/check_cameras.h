// Properties of every calibration that a parser accepts.
#pragma once

#include <cmath>
#include <vector>

#include "common/camera.h"
#include "tests/fuzz/fuzz_check.h"

namespace kinevox {

inline void check_cameras(const std::vector<Camera>& cameras) {
    FUZZ_CHECK(!cameras.empty());
    for (const Camera& c : cameras) {
        FUZZ_CHECK(camera_name_problem(c.name).empty());
        FUZZ_CHECK(c.width > 0 && c.height > 0 && c.fx > 0 && c.fy > 0);
        for (const double value : {c.fx, c.fy, c.cx, c.cy, c.k1, c.k2, c.p1, c.p2, c.k3})
            FUZZ_CHECK(std::isfinite(value));
        const Mat3 identity = c.camera_from_world.rotation * c.camera_from_world.rotation.transposed();
        for (int i = 0; i < 9; ++i) FUZZ_CHECK(std::abs(identity.m[i] - (i % 4 == 0)) < 1e-3);
        FUZZ_CHECK(norm(c.camera_from_world.translation) < 2000);
        // Neither may loop or trap, whatever the distortion.
        (void)c.project({0.3, -0.2, 1.5});
        (void)c.ray_through({0, 0});
        for (const Camera& other : cameras) FUZZ_CHECK(&other == &c || other.name != c.name);
    }
}

}  // namespace kinevox
