// Poses as VMC messages: what an avatar's bones do is held against where the body's limbs point.
#include <gmock/gmock.h>
#include <oscpack/osc/OscReceivedElements.h>

#include <cmath>
#include <map>

#include "client/bridge/datagrams.h"

namespace kinevox::bridge {
namespace {

using ::testing::ElementsAre;
using ::testing::IsEmpty;

const char* const kSegments[] = {"pelvis",  "thorax",      "head",        "thigh_l",   "shank_l",
                                 "foot_l",  "upper_arm_l", "forearm_l",   "hand_l",    "thigh_r",
                                 "shank_r", "foot_r",      "upper_arm_r", "forearm_r", "hand_r"};
const std::map<std::string, std::string> kParents{{"Spine", "Hips"},
                                                  {"Head", "Spine"},
                                                  {"LeftUpperLeg", "Hips"},
                                                  {"LeftLowerLeg", "LeftUpperLeg"},
                                                  {"LeftFoot", "LeftLowerLeg"},
                                                  {"LeftUpperArm", "Spine"},
                                                  {"LeftLowerArm", "LeftUpperArm"},
                                                  {"LeftHand", "LeftLowerArm"},
                                                  {"RightUpperLeg", "Hips"},
                                                  {"RightLowerLeg", "RightUpperLeg"},
                                                  {"RightFoot", "RightLowerLeg"},
                                                  {"RightUpperArm", "Spine"},
                                                  {"RightLowerArm", "RightUpperArm"},
                                                  {"RightHand", "RightLowerArm"}};

v1::Pose standing() {
    v1::Pose pose;
    v1::JointEstimate* root = pose.add_joints();
    root->set_name("root");
    root->mutable_position_in_world()->set_x(2);
    root->mutable_position_in_world()->set_y(0.5);
    root->mutable_position_in_world()->set_z(0.9);
    for (const char* name : kSegments) {
        v1::SegmentOrientation* segment = pose.add_segment_orientations();
        segment->set_name(name);
        segment->mutable_parent_from_segment()->set_w(1);
    }
    return pose;
}

// Turned about an axis of the parent's, right-handed, in Kinevox's axes.
void turn(v1::Pose& pose, const std::string& name, const Vec3& axis, double angle_deg) {
    const double half = angle_deg * M_PI / 360;
    for (v1::SegmentOrientation& segment : *pose.mutable_segment_orientations())
        if (segment.name() == name) {
            v1::Quaternion* q = segment.mutable_parent_from_segment();
            q->set_w(std::cos(half));
            q->set_x(std::sin(half) * axis.x), q->set_y(std::sin(half) * axis.y),
                q->set_z(std::sin(half) * axis.z);
        }
}

// Rotation by x y z w, as every engine does it.
Vec3 rotate(const std::array<double, 4>& q, const Vec3& v) {
    const Vec3 u{q[0], q[1], q[2]};
    const Vec3 t = 2 * cross(u, v);
    return v + q[3] * t + cross(u, t);
}

// Where a vector of a bone's own points in the scene.
Vec3 in_scene(const std::vector<VmcBone>& bones, std::string bone, Vec3 v) {
    for (;;) {
        for (const VmcBone& b : bones)
            if (b.name == bone) v = rotate(b.rotation_xyzw, v);
        const auto parent = kParents.find(bone);
        if (parent == kParents.end()) return v;
        bone = parent->second;
    }
}

void expect_near(const Vec3& a, const Vec3& b) {
    EXPECT_NEAR(norm(a - b), 0, 1e-9)
        << a.x << " " << a.y << " " << a.z << ", not " << b.x << " " << b.y << " " << b.z;
}

// The receiver's axes: x right, y up, z forward. In the T-pose the left arm points to -x, legs to -y, feet to
// +z.
constexpr Vec3 kLeft{-1, 0, 0}, kRight{1, 0, 0}, kDown{0, -1, 0}, kUp{0, 1, 0}, kForward{0, 0, 1};

TEST(VmcTest, HangingArmsHangOnAvatar) {
    const auto bones = vmc_bones(standing());
    ASSERT_EQ(bones.size(), 15U);
    expect_near(bones[0].position, {-0.5, 0.9, 2});
    for (const char* side : {"Left", "Right"}) {
        const Vec3 sideways = side == std::string("Left") ? kLeft : kRight;
        for (const char* part : {"UpperArm", "LowerArm", "Hand"})
            expect_near(in_scene(bones, std::string(side) + part, sideways), kDown);
        expect_near(in_scene(bones, std::string(side) + "Hand", kDown), -sideways);  // palms to the thighs
        expect_near(in_scene(bones, std::string(side) + "UpperLeg", kDown), kDown);
    }
}

TEST(VmcTest, LimbDirectionsMatchBody) {
    v1::Pose pose = standing();
    turn(pose, "upper_arm_l", {1, 0, 0}, 90);   // raised to the left: -z becomes +y
    turn(pose, "upper_arm_r", {0, 1, 0}, -90);  // to the front: -z becomes +x
    turn(pose, "forearm_r", {0, 1, 0}, -90);    // bent on: +x becomes +z
    turn(pose, "thigh_l", {0, 1, 0}, -90);
    turn(pose, "shank_l", {0, 1, 0}, 90);  // a seat
    auto bones = vmc_bones(pose);
    expect_near(in_scene(bones, "LeftUpperArm", kLeft), kLeft);
    expect_near(in_scene(bones, "RightUpperArm", kRight), kForward);
    expect_near(in_scene(bones, "RightLowerArm", kRight), kUp);
    expect_near(in_scene(bones, "LeftUpperLeg", kDown), kForward);
    expect_near(in_scene(bones, "LeftLowerLeg", kDown), kDown);

    turn(pose, "pelvis", {0, 0, 1}, 90);  // turns to her left: forward becomes the scene's left
    bones = vmc_bones(pose);
    expect_near(in_scene(bones, "Hips", kForward), kLeft);
    expect_near(in_scene(bones, "RightUpperArm", kRight), kLeft);
}

TEST(VmcTest, WithheldSegmentsAreNotSent) {
    v1::Pose pose = standing();
    pose.mutable_segment_orientations(4)->clear_parent_from_segment();
    EXPECT_THAT(vmc_bones(pose), IsEmpty());
    pose = standing();
    pose.mutable_joints(0)->clear_position_in_world();
    EXPECT_THAT(vmc_bones(pose), IsEmpty());
}

TEST(VmcTest, DatagramsAreOscWithinEthernetFrame) {
    const v1::Pose pose = standing();
    int bones = 0, ok = -1, subject_id = -1;
    float time_s = 0;
    std::string subject_name;
    for (const std::string& datagram : vmc_datagrams(&pose, 3, 12.5, "Jörg B.")) {
        EXPECT_LE(datagram.size(), 1472U);
        const osc::ReceivedPacket packet(datagram.data(), datagram.size());
        ASSERT_TRUE(packet.IsBundle());
        const osc::ReceivedBundle bundle(packet);
        for (auto element = bundle.ElementsBegin(); element != bundle.ElementsEnd(); ++element) {
            const osc::ReceivedMessage message(*element);
            const std::string address = message.AddressPattern();
            if (address == "/VMC/Ext/OK") ok = message.ArgumentsBegin()->AsInt32();
            if (address == "/Kinevox/Ext/Subject") subject_id = message.ArgumentsBegin()->AsInt32();
            if (address == "/Kinevox/Ext/SubjectName") subject_name = message.ArgumentsBegin()->AsString();
            if (address == "/VMC/Ext/T") time_s = message.ArgumentsBegin()->AsFloat();
            if (address != "/VMC/Ext/Bone/Pos") continue;
            EXPECT_STREQ(message.TypeTags(), "sfffffff");
            ++bones;
        }
    }
    EXPECT_EQ(bones, 15);
    EXPECT_EQ(ok, 1);
    EXPECT_EQ(subject_id, 3);
    EXPECT_EQ(subject_name, "Jörg B.");
    const std::string longest(100, 'a');  // SubjectControl's limit
    for (const std::string& datagram : vmc_datagrams(&pose, 3, 12.5, longest))
        EXPECT_LE(datagram.size(), 1472U);
    EXPECT_EQ(vmc_datagrams(&pose, 3, 12.5).front().find("SubjectName"), std::string::npos);
    EXPECT_FLOAT_EQ(time_s, 12.5f);
    ASSERT_EQ(vmc_datagrams(nullptr, 0, 1).size(), 1U);
}

using Ids = std::vector<std::uint32_t>;
constexpr std::int64_t kSecond_ns = 1'000'000'000;

TEST(AvatarsTest, SubjectsKeepTheirAvatars) {
    Avatars avatars(2);
    EXPECT_THAT(avatars.update(Ids{1}, 1 * kSecond_ns), ElementsAre(1, 0));
    EXPECT_THAT(avatars.update(Ids{1, 2, 3}, 2 * kSecond_ns), ElementsAre(1, 2)) << "no avatar is left for 3";
    EXPECT_THAT(avatars.update(Ids{2, 3}, 3 * kSecond_ns), ElementsAre(0, 2)) << "1 may return";
    EXPECT_THAT(avatars.update(Ids{1, 2, 3}, 3 * kSecond_ns + 1), ElementsAre(1, 2));
    EXPECT_THAT(avatars.update(Ids{2, 3}, 4 * kSecond_ns), ElementsAre(0, 2));
    EXPECT_THAT(avatars.update(Ids{2, 3}, 5 * kSecond_ns), ElementsAre(3, 2)) << "1 is gone";
    EXPECT_THAT(avatars.update(Ids{2}, 1 * kSecond_ns), ElementsAre(2, 0)) << "after a seek";
}

TEST(AvatarsTest, OneAvatarShowsTheFirstAndNewSubjectsAtOnce) {
    Avatars avatars(1);
    EXPECT_THAT(avatars.update(Ids{4, 5}, 1 * kSecond_ns), ElementsAre(4));
    EXPECT_THAT(avatars.update(Ids{5}, 2 * kSecond_ns), ElementsAre(0)) << "not the other person";
    EXPECT_THAT(avatars.update(Ids{5, 6}, 2 * kSecond_ns + 1), ElementsAre(6)) << "4 with a new id";
    EXPECT_THAT(avatars.update(Ids{}, 2 * kSecond_ns + 2), ElementsAre(0));
    EXPECT_THAT(avatars.update(Ids{7}, 2 * kSecond_ns + 3), ElementsAre(7));
}

TEST(UdpSenderTest, InvalidAddressIsNamed) {
    for (const char* bad :
         {"", "host", ":1", "127.0.0.1:", "127.0.0.1:0", "127.0.0.1:65536", "127.0.0.1:12x"})
        EXPECT_TRUE(absl::IsInvalidArgument(UdpSender::open(bad).status())) << bad;
    EXPECT_TRUE(UdpSender::open("127.0.0.1:39539").ok());
    EXPECT_TRUE(UdpSender::open("[::1]:39539").ok());
    EXPECT_TRUE(absl::IsInvalidArgument(UdpSender::open("127.0.0.1:65535", 1).status()));
}

}  // namespace
}  // namespace kinevox::bridge
