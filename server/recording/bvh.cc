// BVH: a skeleton with its motion, as text.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <optional>

#include "common/body_table.h"
#include "common/geometry.h"
#include "server/recording/trial_formats.h"

namespace kinevox {
namespace {

constexpr double kCentimetres = 100;
// x left, y up, z forward, from x forward, y left, z up.
constexpr Mat3 kBvhFromWorld{{0, 1, 0, 0, 0, 1, 1, 0, 0}};
// As the model's coordinates: the root's singular pose is lying on the side, a limb's is out of its range.
// Flexion about x, adduction about z, rotation about y.
constexpr EulerOrder kRootOrder{kAxisY, kAxisZ, kAxisX}, kLimbOrder{kAxisX, kAxisZ, kAxisY};
// The clavicle's inner end, as a fraction of the way from the midline to the shoulder.
constexpr double kClavicleStart = 0.15;

Vec3 to_bvh(Vec3 v) {
    return kCentimetres * (kBvhFromWorld * v);
}
Mat3 to_bvh(const Mat3& r) {
    return kBvhFromWorld * r * kBvhFromWorld.transposed();
}

Vec3 clavicle_start(const BodyModel& model, int arm) {
    const Vec3 shoulder = model.offset_in_parent(arm);
    return {shoulder.x, kClavicleStart * shoulder.y, shoulder.z};
}

Vec3 offset_of(const BodyModel& model, const BvhNode& node) {
    if (node.segment == kPelvis) return {0, 0, 0};
    const Vec3 offset = model.offset_in_parent(node.segment);
    const bool arm = node.segment == kUpperArmL || node.segment == kUpperArmR;
    if (!arm) return offset;
    const Vec3 start = clavicle_start(model, node.segment);
    return node.clavicle ? start : offset - start;
}

// The smallest rotation from the direction of `from` to that of `to`.
Mat3 rotation_between(Vec3 from, Vec3 to) {
    const Vec3 axis = cross(from, to);
    const double sine = norm(axis);
    if (sine < 1e-12) return Mat3{};
    return rotation_from_rodrigues(std::atan2(sine, dot(from, to)) / sine * axis);
}

Mat3 clavicle_rotation(const BodyModel& model, const BodyPosture& posture, int arm) {
    const Vec3 rest = model.offset_in_parent(arm) - clavicle_start(model, arm);
    return rotation_between(
        rest,
        rest + model.shoulder_shift(arm == kUpperArmL, posture.parent_from_segment[arm] * Vec3{0, 0, -1}));
}

Mat3 rotation_of(const BodyModel& model, const BodyPosture& posture, const BvhNode& node) {
    if (node.clavicle) return clavicle_rotation(model, posture, node.segment);
    const Mat3& rotation = posture.parent_from_segment[node.segment];
    const bool arm = node.segment == kUpperArmL || node.segment == kUpperArmR;
    return arm ? clavicle_rotation(model, posture, node.segment).transposed() * rotation : rotation;
}

std::string hierarchy(const BodyModel& model) {
    constexpr std::string_view kAxes = "XYZ";
    std::string text = "HIERARCHY\n";
    const auto line = [&text](int depth, const std::string& words) {
        text += std::string(depth, '\t') + words + '\n';
    };
    const auto offset = [](Vec3 v) {
        const Vec3 b = to_bvh(v);
        return fmt::format("OFFSET {:.4f} {:.4f} {:.4f}", b.x + 0.0, b.y + 0.0, b.z + 0.0);
    };
    for (std::size_t n = 0; n < kBvhNodes.size(); ++n) {
        const BvhNode& node = kBvhNodes[n];
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
        const int next = n + 1 < kBvhNodes.size() ? kBvhNodes[n + 1].depth : 0;
        for (int depth = node.depth; depth >= next && (depth > 0 || n + 1 == kBvhNodes.size()); --depth)
            line(depth, "}");
    }
    return text;
}

// A single lost frame set repeats the one before it; returns how many do.
std::int64_t bridge_lost_frames(const Trial& trial, std::vector<BodyCoordinates>& coordinates) {
    const auto lost = [&](std::size_t n) { return trial.session_frames[n] < 0; };
    std::int64_t bridged = 0;
    for (std::size_t n = 1; n + 1 < coordinates.size(); ++n) {
        if (!lost(n) || lost(n - 1) || lost(n + 1)) continue;
        coordinates[n] = coordinates[n - 1];
        ++bridged;
    }
    return bridged;
}

// Every coordinate measured or, with `hold`, the last measured value; the first measured one before that.
absl::StatusOr<std::vector<BodyCoordinates>> complete_coordinates(const Trial& trial, bool hold,
                                                                  BvhGaps& gaps) {
    std::vector<BodyCoordinates> out = trial.coordinates;
    gaps.bridged_frames = bridge_lost_frames(trial, out);
    const std::vector<BodyCoordinates> measured = out;
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
                    "{}: {} is withheld in every frame, and BVH has no missing values; export TRC or C3D",
                    (trial.folder / "coordinates.csv").string(), kBodyDofs[d].name));
            out[n][d] = *last;
        }
    }
    gaps.held_frames = std::count(frame_held.begin(), frame_held.end(), true);
    if (gaps.held_frames > 0 && !hold) {
        const auto n = std::find(frame_held.begin(), frame_held.end(), true) - frame_held.begin();
        int d = 0;
        while (!std::isnan(measured[n][d])) ++d;
        return absl::FailedPreconditionError(fmt::format(
            "{}: {} is {} in frame {} ({} frames are incomplete), and BVH has no missing values; repeat the "
            "last value with --hold-withheld, or export other frames with --range FIRST-LAST",
            (trial.folder / "coordinates.csv").string(), kBodyDofs[d].name,
            trial.session_frames[n] < 0 ? "lost" : "withheld", trial.frames[n], gaps.held_frames));
    }
    return out;
}

}  // namespace

absl::StatusOr<std::string> bvh_file(const Trial& trial, bool hold_withheld, BvhGaps* reported) {
    if (absl::Status complete = needs_coordinates_and_body(trial, "BVH"); !complete.ok()) return complete;
    BvhGaps gaps;
    const auto coordinates = complete_coordinates(trial, hold_withheld, gaps);
    if (!coordinates.ok()) return coordinates.status();
    if (reported) *reported = gaps;
    const BodyModel model(*trial.body);
    std::string text = hierarchy(model);
    const auto put = [&text]<class... T>(fmt::format_string<T...> format, T&&... values) {
        fmt::format_to(std::back_inserter(text), format, std::forward<T>(values)...);
    };
    put("MOTION\nFrames: {}\nFrame Time: {:.8g}\n", trial.size(), 1 / trial.rate_hz);
    std::vector<EulerAngles> last(kBvhNodes.size());
    for (const BodyCoordinates& q : *coordinates) {
        const BodyPosture posture = posture_from_coordinates(q);
        const Vec3 root = to_bvh(posture.root_in_world);
        put("{:.4f} {:.4f} {:.4f}", root.x, root.y, root.z);
        for (std::size_t n = 0; n < kBvhNodes.size(); ++n) {
            const Mat3 rotation = to_bvh(rotation_of(model, posture, kBvhNodes[n]));
            last[n] = nearest_euler(euler_from_rotation(rotation, n == 0 ? kRootOrder : kLimbOrder), last[n]);
            for (const double angle : last[n]) put(" {:.5f}", degrees(angle) + 0.0);
        }
        text += '\n';
    }
    return text;
}

}  // namespace kinevox
