// Poses as messages of the Virtual Motion Capture protocol (OSC over UDP), which game engines' receivers
// understand: protocol.vmc.info/english. The performer's side ("Marionette" receives).
#pragma once

#include <array>
#include <string>
#include <vector>

#include "common/geometry.h"
#include "kinevox/v1/pose.pb.h"

namespace kinevox::bridge {

// The default port of VMC receivers.
inline constexpr int kVmcPort = 39539;

// x to the right, y up, z forward: left-handed, as VMC and Unity have it.
struct VmcBone {
    const char* name;                     // of Unity's HumanBodyBones
    Vec3 position;                        // m, in the parent; of the hips in the scene, others zero
    std::array<double, 4> rotation_xyzw;  // parent from bone; none in the T-pose
};

// The bones of a pose, parents before children; empty where its segments are withheld. A person who faces
// Kinevox's +x looks along the receiver's +z.
std::vector<VmcBone> vmc_bones(const v1::Pose& pose);

// Datagrams of at most 1472 bytes, below the MTU of Ethernet: state and time, then the bones. No pose:
// /VMC/Ext/OK 0.
std::vector<std::string> vmc_datagrams(const v1::Pose* pose, double time_s);

}  // namespace kinevox::bridge
