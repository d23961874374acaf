#include "client/bridge/datagrams.h"

#include <fmt/format.h>
#include <oscpack/osc/OscOutboundPacketStream.h>

#include <algorithm>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/udp.hpp>
#include <cmath>
#include <map>
#include <optional>
#include <string_view>
#include <utility>

#include "common/body_table.h"
#include "common/host_port.h"

namespace kinevox::bridge {
namespace {

constexpr std::size_t kDatagram_bytes = 1472;
constexpr std::size_t kBonesADatagram = 12;  // of some 90 bytes

struct Quat {
    double w = 1, x = 0, y = 0, z = 0;

    friend Quat operator*(const Quat& a, const Quat& b) {
        return {a.w * b.w - a.x * b.x - a.y * b.y - a.z * b.z, a.w * b.x + a.x * b.w + a.y * b.z - a.z * b.y,
                a.w * b.y - a.x * b.z + a.y * b.w + a.z * b.x, a.w * b.z + a.x * b.y - a.y * b.x + a.z * b.w};
    }
    Quat conjugate() const { return {w, -x, -y, -z}; }
};

enum class Rest { kSame, kLeftArm, kRightArm };

// Of a segment, which kVmcBoneNames gives its bone.
Rest rest_of(int segment) {
    if (segment == kUpperArmL || segment == kForearmL || segment == kHandL) return Rest::kLeftArm;
    if (segment == kUpperArmR || segment == kForearmR || segment == kHandR) return Rest::kRightArm;
    return Rest::kSame;
}

// At rest the body model stands with hanging arms, palms towards the thighs; a humanoid in the T-pose.
// segment from bone: a quarter turn about x, which rotates the T-pose's arm down.
Quat segment_from_bone(Rest rest) {
    const double half = std::sqrt(0.5);
    switch (rest) {
        case Rest::kLeftArm:
            return {half, -half, 0, 0};
        case Rest::kRightArm:
            return {half, half, 0, 0};
        case Rest::kSame:
            break;
    }
    return {};
}

// From x forward, y left, z up, right-handed. The reflection inverts the sense of rotations.
Vec3 to_vmc(const Vec3& v) {
    return {-v.y, v.z, v.x};
}
std::array<double, 4> to_vmc(const Quat& q) {
    return {q.y, -q.z, -q.x, q.w};
}

std::string datagram(const auto& write) {
    std::array<char, kDatagram_bytes> room;
    osc::OutboundPacketStream stream(room.data(), room.size());
    stream << osc::BeginBundleImmediate;
    write(stream);
    stream << osc::EndBundle;
    return {stream.Data(), stream.Size()};
}

}  // namespace

std::vector<VmcBone> vmc_bones(const v1::Pose& pose) {
    std::map<std::string_view, Quat> parent_from_segment;
    for (const v1::SegmentOrientation& s : pose.segment_orientations())
        if (s.has_parent_from_segment()) {
            const v1::Quaternion& q = s.parent_from_segment();
            parent_from_segment[s.name()] = {q.w(), q.x(), q.y(), q.z()};
        }
    std::optional<Vec3> root;
    for (const v1::JointEstimate& joint : pose.joints())
        if (joint.name() == "root" && joint.has_position_in_world())
            root = Vec3{joint.position_in_world().x(), joint.position_in_world().y(),
                        joint.position_in_world().z()};
    std::vector<VmcBone> bones;
    if (!root) return bones;
    for (int segment = 0; segment < kBodySegmentCount; ++segment) {
        const auto found = parent_from_segment.find(kBodySegmentNames[segment]);
        if (found == parent_from_segment.end()) return {};
        const Rest parent_rest = segment == kPelvis ? Rest::kSame : rest_of(kBodyParent[segment]);
        const Quat rotation =
            segment_from_bone(parent_rest).conjugate() * found->second * segment_from_bone(rest_of(segment));
        bones.push_back(
            {kVmcBoneNames[segment].data(), segment == kPelvis ? to_vmc(*root) : Vec3{}, to_vmc(rotation)});
    }
    return bones;
}

std::vector<std::string> vmc_datagrams(const v1::Pose* pose, std::uint32_t subject_id, double time_s,
                                       const std::string& subject_name) {
    const std::vector<VmcBone> bones = pose ? vmc_bones(*pose) : std::vector<VmcBone>{};
    std::vector<std::string> datagrams;
    datagrams.push_back(datagram([&](osc::OutboundPacketStream& out) {
        out << osc::BeginMessage("/VMC/Ext/OK") << static_cast<osc::int32>(!bones.empty()) << osc::EndMessage;
        out << osc::BeginMessage("/VMC/Ext/T") << static_cast<float>(time_s) << osc::EndMessage;
        out << osc::BeginMessage("/Kinevox/Ext/Subject") << static_cast<osc::int32>(subject_id)
            << osc::EndMessage;
        if (!subject_name.empty())
            out << osc::BeginMessage("/Kinevox/Ext/SubjectName") << subject_name.c_str() << osc::EndMessage;
        if (bones.empty()) return;
        out << osc::BeginMessage("/VMC/Ext/Root/Pos") << "root";
        for (const float value : {0.f, 0.f, 0.f, 0.f, 0.f, 0.f, 1.f}) out << value;
        out << osc::EndMessage;
    }));
    for (std::size_t first = 0; first < bones.size(); first += kBonesADatagram)
        datagrams.push_back(datagram([&](osc::OutboundPacketStream& out) {
            for (std::size_t n = first; n < std::min(bones.size(), first + kBonesADatagram); ++n) {
                const VmcBone& bone = bones[n];
                out << osc::BeginMessage("/VMC/Ext/Bone/Pos") << bone.name;
                for (const double value : {bone.position.x, bone.position.y, bone.position.z})
                    out << static_cast<float>(value);
                for (const double value : bone.rotation_xyzw) out << static_cast<float>(value);
                out << osc::EndMessage;
            }
        }));
    return datagrams;
}

std::vector<std::uint32_t> Avatars::update(std::span<const std::uint32_t> subject_ids, std::int64_t now_ns) {
    if (now_ns < latest_ns_) *this = Avatars(static_cast<int>(avatars_.size()));
    latest_ns_ = now_ns;
    const auto of = [&](std::uint32_t id) { return std::ranges::find(avatars_, id, &Avatar::subject_id); };
    for (Avatar& avatar : avatars_) {
        if (std::ranges::count(subject_ids, avatar.subject_id) > 0) avatar.seen_ns = now_ns;
        if (now_ns - avatar.seen_ns > kKept_ns) avatar = {};
    }
    std::vector<std::uint32_t> shown(avatars_.size(), 0);
    for (const std::uint32_t id : subject_ids) {
        auto avatar = of(id);
        if (avatar == avatars_.end()) avatar = of(0);
        if (avatar == avatars_.end() && id > newest_id_)
            avatar = std::ranges::find_if(avatars_, [&](const Avatar& a) { return a.seen_ns < now_ns; });
        if (avatar == avatars_.end()) continue;
        *avatar = {id, now_ns};
        shown[static_cast<std::size_t>(avatar - avatars_.begin())] = id;
    }
    for (const std::uint32_t id : subject_ids) newest_id_ = std::max(newest_id_, id);
    return shown;
}

using boost::asio::ip::udp;

struct UdpSender::Socket {
    boost::asio::io_context io;
    udp::socket socket{io};
    udp::endpoint to;
};

UdpSender::UdpSender(std::unique_ptr<Socket> socket) : socket_(std::move(socket)) {}
UdpSender::~UdpSender() = default;
UdpSender::UdpSender(UdpSender&&) noexcept = default;

absl::StatusOr<UdpSender> UdpSender::open(const std::string& to, int port_offset) {
    const auto address = parse_host_port(to);
    constexpr int kMaxPort = 65'535;
    if (address && address->port + port_offset > kMaxPort)
        return absl::InvalidArgumentError(
            fmt::format("\"{}\" leaves no port for {} further subjects; give a lower port", to, port_offset));
    if (!address || address->port == 0)
        return absl::InvalidArgumentError(
            fmt::format("\"{}\" is not HOST:PORT; give an address such as 127.0.0.1:39539", to));
    auto socket = std::make_unique<Socket>();
    boost::system::error_code error;
    const auto found =
        udp::resolver(socket->io).resolve(address->host, std::to_string(address->port + port_offset), error);
    if (error || found.empty())
        return absl::NotFoundError(fmt::format("host {} cannot be resolved ({}); give an IP address",
                                               address->host, error.message()));
    socket->to = found.begin()->endpoint();
    socket->socket.open(socket->to.protocol(), error);
    if (!error) socket->socket.set_option(udp::socket::broadcast(true), error);
    if (!error) socket->socket.non_blocking(true, error);
    if (error) return absl::UnavailableError(fmt::format("no socket for {}: {}", to, error.message()));
    return UdpSender(std::move(socket));
}

void UdpSender::send(std::span<const char> datagram) {
    boost::system::error_code error;
    socket_->socket.send_to(boost::asio::buffer(datagram.data(), datagram.size()), socket_->to, 0, error);
    ++(error ? dropped_ : sent_);  // also an error while no receiver listens
}

}  // namespace kinevox::bridge
