// Results of the daemon, ready to be drawn.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "client/viewer/volume_points.h"
#include "common/body_table.h"
#include "common/geometry.h"

namespace kinevox::viewer {

struct ShownVolume {
    std::uint64_t sequence = 0;
    std::int64_t capture_time_ns = 0;            // UTC
    std::optional<std::int64_t> recorded_frame;  // in a replay
    std::vector<SurfacePoint> points;            // none: no subject
    double voxel_m = 0, volume_litres = 0;
    std::optional<Vec3> subject_in_world;  // m; of the first subject
};

struct ShownAngle {
    std::string name;                 // as in angles.csv, without "_deg"
    std::optional<double> value_deg;  // empty: withheld
};

struct ShownPose {
    std::uint64_t sequence = 0;
    std::int64_t capture_time_ns = 0;
    std::optional<std::int64_t> recorded_frame;
    bool found = false;  // a subject is tracked and its pose was found
    std::array<std::optional<Vec3>, kJointNames.size()> joints_in_world;  // m
    std::vector<ShownAngle> angles;
};

}  // namespace kinevox::viewer
