// BVH: a skeleton with its motion, as text.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>

#include "common/body_pose.h"
#include "common/degrees.h"
#include "server/recording/euler_angles.h"
#include "server/recording/trial_formats.h"

namespace kinevox {
namespace {

constexpr double kCentimetres = 100;
// x left, y up, z forward, from x forward, y left, z up.
constexpr Mat3 kBvhFromWorld{{0, 1, 0, 0, 0, 1, 1, 0, 0}};
// The order of the body's own angles: the singular pose of the root is lying on one's side, that of a limb is
// far from what a limb does. Flexion about x, adduction about z, rotation about y.
constexpr EulerOrder kRootOrder{kAxisY, kAxisZ, kAxisX}, kLimbOrder{kAxisX, kAxisZ, kAxisY};
// Of the clavicle's inner end, part of the way from the middle to the shoulder.
constexpr double kClavicleStart = 0.15;

Vec3 to_bvh(Vec3 v) {
    return kCentimetres * (kBvhFromWorld * v);
}
Mat3 to_bvh(const Mat3& r) {
    return kBvhFromWorld * r * kBvhFromWorld.transposed();
}

// A joint: a segment of the body, or a clavicle.
struct Node {
    std::string_view name;
    int segment;         // that it turns; of a clavicle: the upper arm
    int depth;           // in the hierarchy: it is a child of the last node before it that is one less deep
    int end_joint = -1;  // index in kJointNames of an end below it
    bool clavicle = false;
};

int joint(std::string_view name) {
    return static_cast<int>(*joint_index(name));
}

std::vector<Node> skeleton() {
    return {{"Hips", kPelvis, 0},
            {"Spine", kThorax, 1},
            {"Head", kHead, 2, joint("head_top")},
            {"LeftShoulder", kUpperArmL, 2, -1, true},
            {"LeftArm", kUpperArmL, 3},
            {"LeftForeArm", kForearmL, 4},
            {"LeftHand", kHandL, 5, joint("hand_l")},
            {"RightShoulder", kUpperArmR, 2, -1, true},
            {"RightArm", kUpperArmR, 3},
            {"RightForeArm", kForearmR, 4},
            {"RightHand", kHandR, 5, joint("hand_r")},
            {"LeftUpLeg", kThighL, 1},
            {"LeftLeg", kShankL, 2},
            {"LeftFoot", kFootL, 3, joint("toe_l")},
            {"RightUpLeg", kThighR, 1},
            {"RightLeg", kShankR, 2},
            {"RightFoot", kFootR, 3, joint("toe_r")}};
}

Vec3 clavicle_start(const BodyModel& model, int arm) {
    const Vec3 shoulder = model.offset_in_parent(arm);
    return {shoulder.x, kClavicleStart * shoulder.y, shoulder.z};
}

Vec3 offset_of(const BodyModel& model, const Node& node) {
    if (node.segment == kPelvis) return {0, 0, 0};
    const Vec3 offset = model.offset_in_parent(node.segment);
    const bool arm = node.segment == kUpperArmL || node.segment == kUpperArmR;
    if (!arm) return offset;
    const Vec3 start = clavicle_start(model, node.segment);
    return node.clavicle ? start : offset - start;
}

// The smallest turn that takes the direction of `from` to that of `to`.
Mat3 turn_between(Vec3 from, Vec3 to) {
    const Vec3 axis = cross(from, to);
    const double sine = norm(axis);
    if (sine < 1e-12) return Mat3{};
    return rotation_from_rodrigues(std::atan2(sine, dot(from, to)) / sine * axis);
}

Mat3 clavicle_turn(const BodyModel& model, const BodyPosture& posture, int arm) {
    const Vec3 rest = model.offset_in_parent(arm) - clavicle_start(model, arm);
    return turn_between(rest, rest + model.shoulder_shift(arm == kUpperArmL,
                                                          posture.parent_from_segment[arm] * Vec3{0, 0, -1}));
}

Mat3 rotation_of(const BodyModel& model, const BodyPosture& posture, const Node& node) {
    if (node.clavicle) return clavicle_turn(model, posture, node.segment);
    const Mat3& turn = posture.parent_from_segment[node.segment];
    const bool arm = node.segment == kUpperArmL || node.segment == kUpperArmR;
    return arm ? clavicle_turn(model, posture, node.segment).transposed() * turn : turn;
}

std::string hierarchy(const BodyModel& model, const std::vector<Node>& nodes) {
    constexpr std::string_view kAxes = "XYZ";
    std::string text = "HIERARCHY\n";
    const auto line = [&text](int depth, const std::string& words) {
        text += std::string(depth, '\t') + words + '\n';
    };
    const auto offset = [](Vec3 v) {
        const Vec3 b = to_bvh(v);
        return fmt::format("OFFSET {:.4f} {:.4f} {:.4f}", b.x + 0.0, b.y + 0.0, b.z + 0.0);
    };
    for (std::size_t n = 0; n < nodes.size(); ++n) {
        const Node& node = nodes[n];
        const EulerOrder& order = n == 0 ? kRootOrder : kLimbOrder;
        std::string rotations;
        for (const Axis axis : order) rotations += fmt::format(" {}rotation", kAxes[axis]);
        line(node.depth, fmt::format("{} {}", n == 0 ? "ROOT" : "JOINT", node.name));
        line(node.depth, "{");
        line(node.depth + 1, offset(offset_of(model, node)));
        line(node.depth + 1,
             (n == 0 ? "CHANNELS 6 Xposition Yposition Zposition" : "CHANNELS 3") + rotations);
        if (node.end_joint >= 0) {
            line(node.depth + 1, "End Site");
            line(node.depth + 1, "{");
            line(node.depth + 2, offset(model.joint_in_segment(node.end_joint)));
            line(node.depth + 1, "}");
        }
        const int next = n + 1 < nodes.size() ? nodes[n + 1].depth : 0;
        for (int depth = node.depth; depth >= next && (depth > 0 || n + 1 == nodes.size()); --depth)
            line(depth, "}");
    }
    return text;
}

// Every coordinate measured or, with `hold`, the last measured value; before the first one that one.
absl::StatusOr<std::vector<BodyCoordinates>> whole_coordinates(const Trial& trial, bool hold,
                                                               std::int64_t& held) {
    std::vector<BodyCoordinates> out = trial.coordinates;
    std::vector<bool> frame_held(out.size());
    for (int d = 0; d < kBodyDofCount; ++d) {
        std::optional<double> last;
        for (std::size_t n = 0; n < out.size() && !last; ++n)
            if (!std::isnan(out[n][d])) last = out[n][d];
        for (std::size_t n = 0; n < out.size(); ++n) {
            if (!std::isnan(out[n][d])) {
                last = out[n][d];
                continue;
            }
            frame_held[n] = true;
            if (!last)
                return absl::FailedPreconditionError(fmt::format(
                    "{}: {} was measured in no frame, and BVH cannot leave it out; export TRC or C3D",
                    (trial.folder / "coordinates.csv").string(), kBodyDofs[d].name));
            out[n][d] = *last;
        }
    }
    held = std::count(frame_held.begin(), frame_held.end(), true);
    if (held > 0 && !hold) {
        const auto n = std::find(frame_held.begin(), frame_held.end(), true) - frame_held.begin();
        int d = 0;
        while (!std::isnan(trial.coordinates[n][d])) ++d;
        return absl::FailedPreconditionError(fmt::format(
            "{}: {} is withheld in frame {} ({} frames lack something), and BVH has no way to say so; give "
            "--hold to "
            "repeat the last measured value, or --frames FIRST-LAST for a part",
            (trial.folder / "coordinates.csv").string(), kBodyDofs[d].name, trial.frames[n], held));
    }
    return out;
}

}  // namespace

absl::StatusOr<std::string> bvh_file(const Trial& trial, bool hold, std::int64_t* held_frames) {
    if (absl::Status whole = needs_coordinates_and_body(trial, "BVH"); !whole.ok()) return whole;
    std::int64_t held = 0;
    const auto coordinates = whole_coordinates(trial, hold, held);
    if (!coordinates.ok()) return coordinates.status();
    if (held_frames) *held_frames = held;
    const BodyModel model(*trial.body);
    const std::vector<Node> nodes = skeleton();
    std::string text = hierarchy(model, nodes);
    const auto put = [&text]<class... T>(fmt::format_string<T...> format, T&&... values) {
        fmt::format_to(std::back_inserter(text), format, std::forward<T>(values)...);
    };
    put("MOTION\nFrames: {}\nFrame Time: {:.8g}\n", trial.size(), 1 / trial.rate_hz);
    std::vector<EulerAngles> last(nodes.size());
    for (const BodyCoordinates& q : *coordinates) {
        const BodyPosture posture = posture_from_coordinates(q);
        const Vec3 root = to_bvh(posture.root_in_world);
        put("{:.4f} {:.4f} {:.4f}", root.x, root.y, root.z);
        for (std::size_t n = 0; n < nodes.size(); ++n) {
            const Mat3 turn = to_bvh(rotation_of(model, posture, nodes[n]));
            last[n] = nearest_euler(euler_from_rotation(turn, n == 0 ? kRootOrder : kLimbOrder), last[n]);
            for (const double angle : last[n]) put(" {:.5f}", degrees(angle) + 0.0);
        }
        text += '\n';
    }
    return text;
}

}  // namespace kinevox
