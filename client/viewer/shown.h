// Results of the daemon, ready to be drawn. No Qt, no OpenGL.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "common/body_table.h"
#include "common/geometry.h"
#include "common/volume.h"

namespace kinevox::viewer {

// The surface of a volume as points for drawing. Layout in graphics memory: 20 bytes.
struct SurfacePoint {
    float x = 0, y = 0, z = 0;  // m, world, centre of the voxel
    std::uint8_t r = 0, g = 0, b = 0, a = 255;
    std::int8_t nx = 0, ny = 0, nz = 127, unused = 0;  // outwards, 127 long, world
};
static_assert(sizeof(SurfacePoint) == 20);

// One point per surface voxel. Normals point away from the voxels within a radius of three; without colours
// all points are grey.
std::vector<SurfacePoint> surface_points(const Volume& volume);

struct ShownSubject {
    std::uint32_t id = 0;
    std::size_t first_point = 0, point_count = 0;  // in ShownVolume::points
    Vec3 centre_in_world;                          // m
};

struct ShownVolume {
    std::uint64_t sequence = 0;
    std::int64_t capture_time_ns = 0;            // UTC
    std::optional<std::int64_t> recorded_frame;  // in a replay
    std::vector<SurfacePoint> points;            // of all subjects, one after the other; none: no subject
    double voxel_m = 0, volume_litres = 0;       // volume of all
    std::vector<ShownSubject> subjects;          // ordered by id

    // Null: not tracked now.
    const ShownSubject* subject(std::uint32_t id) const;
};

struct ShownAngle {
    std::string name;                 // as in angles.csv, without "_deg"
    std::optional<double> value_deg;  // empty: withheld
};

// Of one subject.
struct ShownPose {
    std::uint32_t subject_id = 0;  // 0: none is tracked
    std::string subject_name;      // empty: none
    std::uint64_t sequence = 0;
    std::int64_t capture_time_ns = 0;
    std::optional<std::int64_t> recorded_frame;
    bool found = false;  // a subject is tracked and its pose was found
    std::array<std::optional<Vec3>, kJointNames.size()> joints_in_world;  // m
    std::vector<ShownAngle> angles;
};

// Of all subjects.
struct ShownPoses {
    std::uint64_t sequence = 0;
    std::int64_t capture_time_ns = 0;            // UTC
    std::optional<std::int64_t> recorded_frame;  // in a replay
    std::vector<ShownPose> subjects;             // ordered by id

    // Without joints and angles if the subject is not tracked now.
    ShownPose pose(std::uint32_t id) const;
};

}  // namespace kinevox::viewer
