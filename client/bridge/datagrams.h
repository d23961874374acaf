// Poses as messages of the Virtual Motion Capture protocol (OSC over UDP), which game engines' receivers
// understand: protocol.vmc.info/english. The performer's side ("Marionette" receives). And sending datagrams,
// of these or of other messages.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <memory>
#include <span>
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

// Datagrams of at most 1472 bytes, below the MTU of Ethernet: state, time and the subject's id
// (/Kinevox/Ext/Subject, which receivers of the protocol ignore) and name, if there is one
// (/Kinevox/Ext/SubjectName), then the bones. No pose: /VMC/Ext/OK 0.
std::vector<std::string> vmc_datagrams(const v1::Pose* pose, std::uint32_t subject_id, double time_s,
                                       const std::string& subject_name = {});

// Assigns subjects to avatars, lower ids first. A subject keeps its avatar while it is seen and for a time
// after it was lost, so that an avatar does not jump to another person; only a new subject, who may be the
// same person, takes it at once.
class Avatars {
  public:
    static constexpr std::int64_t kKept_ns = 1'500'000'000;

    explicit Avatars(int count) : avatars_(static_cast<std::size_t>(count)) {}

    // Subject of each avatar; 0: none is seen now. Times that go back, as in a replay, free all avatars.
    std::vector<std::uint32_t> update(std::span<const std::uint32_t> subject_ids, std::int64_t now_ns);

  private:
    struct Avatar {
        std::uint32_t subject_id = 0;  // 0: free
        std::int64_t seen_ns = 0;
    };
    std::vector<Avatar> avatars_;
    std::int64_t latest_ns_ = 0;
    std::uint32_t newest_id_ = 0;
};

// Datagrams to one address. One that cannot be sent immediately is dropped and counted.
class UdpSender {
  public:
    // `to`: HOST:PORT, a name or an address; a broadcast address is allowed. InvalidArgument, NotFound.
    // `port_offset` is added to the port.
    static absl::StatusOr<UdpSender> open(const std::string& to, int port_offset = 0);
    ~UdpSender();
    UdpSender(UdpSender&&) noexcept;

    void send(std::span<const char> datagram);
    std::uint64_t sent() const { return sent_; }
    std::uint64_t dropped() const { return dropped_; }

  private:
    struct Socket;
    explicit UdpSender(std::unique_ptr<Socket> socket);
    std::unique_ptr<Socket> socket_;
    std::uint64_t sent_ = 0, dropped_ = 0;
};

}  // namespace kinevox::bridge
