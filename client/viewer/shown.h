// What the viewer shows, as it came from the daemon and ready to be drawn.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/viewer/volume_points.h"
#include "common/geometry.h"
#include "common/skeleton.h"

namespace kinevox::viewer {

struct ShownVolume {
    std::uint64_t sequence = 0;
    std::int64_t capture_time_ns = 0;            // UTC
    std::optional<std::int64_t> recorded_frame;  // of a recording that is replayed
    std::vector<SurfacePoint> points;            // none: nobody is tracked
    double voxel_m = 0, litres = 0;
    std::optional<Vec3> subject_in_world;  // m
};

struct ShownAngle {
    std::string name;                 // as in angles.csv, without "_deg"
    std::optional<double> value_deg;  // nothing: withheld
};

struct ShownPose {
    std::uint64_t sequence = 0;
    std::int64_t capture_time_ns = 0;
    std::optional<std::int64_t> recorded_frame;
    bool found = false;  // somebody is tracked and her pose is known
    std::array<std::optional<Vec3>, kJointNames.size()> joints_in_world;  // m
    std::vector<ShownAngle> angles;
};

}  // namespace kinevox::viewer
