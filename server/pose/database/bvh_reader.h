// BVH (Biovision hierarchy) text: a skeleton and its movement. None of Debian's packages reads it.
#pragma once

#include <absl/status/statusor.h>

#include <string>
#include <string_view>
#include <vector>

#include "common/geometry.h"

namespace kinevox {

enum class BvhChannel { kXposition, kYposition, kZposition, kXrotation, kYrotation, kZrotation };

struct BvhJoint {
    std::string name;
    int parent = -1;  // before this one in the list; -1 for the root
    Vec3 offset;      // from the parent, in the file's unit
    std::vector<BvhChannel> channels;
    int first_value = 0;  // of its channels in a frame
    bool has_end = false;
    Vec3 end;  // of a last joint, from itself
};

struct BvhMotion {
    std::vector<BvhJoint> joints;
    int frames = 0;
    double frame_time_s = 0;
    int values_per_frame = 0;
    std::vector<float> values;  // [frame][value]; degrees and the file's unit

    // Positions of all joints and their rotations against the file's axes.
    std::vector<Rigid3> pose(int frame) const;
    // With all angles 0.
    std::vector<Rigid3> rest() const;
};

// Any bytes; an error names the line and what was expected there.
absl::StatusOr<BvhMotion> parse_bvh(std::string_view text, const std::string& name_for_errors);

}  // namespace kinevox
