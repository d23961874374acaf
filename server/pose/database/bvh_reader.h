// Reads BVH (Biovision hierarchy) text: a skeleton and its motion. No Debian package provides this.
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
    int parent = -1;  // precedes this one in the list; -1: root
    Vec3 offset;      // from the parent, in the file's unit
    std::vector<BvhChannel> channels;
    int first_value = 0;  // of its channels in a frame
    bool has_end = false;
    Vec3 end;  // end site of a last joint, from itself
};

struct BvhMotion {
    std::vector<BvhJoint> joints;
    int frames = 0;
    double frame_time_s = 0;
    int values_per_frame = 0;
    std::vector<float> values;  // [frame][value]; degrees and the file's unit

    // Pose of all joints in the file's axes.
    std::vector<Rigid3> pose(int frame) const;
    // With all angles 0.
    std::vector<Rigid3> rest() const;
};

// Accepts arbitrary bytes; errors name the line and the expected token.
absl::StatusOr<BvhMotion> parse_bvh(std::string_view text, const std::string& name_for_errors);

}  // namespace kinevox
