#include "server/pose/database/pose_library.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "server/pose/database/pose_builder.h"

namespace kinevox {
namespace {

// A portable generator: the standard's distributions differ between libraries.
class Draw {
  public:
    std::uint32_t below(std::uint32_t n) {
        state_ = state_ * 6364136223846793005ull + 1442695040888963407ull;
        return static_cast<std::uint32_t>((state_ >> 33) % n);
    }

  private:
    std::uint64_t state_ = 20240601;
};

constexpr bool belongs_to_legs(int dof) {
    return dof < kDofSacroiliac || (dof >= kDofHipL && dof < kDofShoulderL) ||
           (dof >= kDofHipR && dof < kDofShoulderR);
}

// Legs and pelvis of one pose with trunk, arms and head of another.
BodyCoordinates legs_and_arms(const BodyCoordinates& legs, const BodyCoordinates& arms) {
    BodyCoordinates q = arms;
    for (int dof = 0; dof < kBodyDofCount; ++dof)
        if (belongs_to_legs(dof)) q[dof] = legs[dof];
    // The trunk keeps its orientation in the world within the limits of its joint, so that a tilted pelvis
    // does not tilt an upright trunk.
    q[kDofSacroiliac] =
        std::clamp(arms[kDofSacroiliac] + 0.5 * (arms[kDofRootRotation] - legs[kDofRootRotation]),
                   kBodyDofs[kDofSacroiliac].lower, kBodyDofs[kDofSacroiliac].upper);
    return q;
}

const std::vector<LibraryPose>& all_key_poses() {
    static const std::vector<LibraryPose> poses = [] {
        std::vector<LibraryPose> all;
        database::add_leg_poses(all);
        database::add_arm_poses(all);
        for (LibraryPose& pose : all)
            for (int dof = kDofSacroiliac; dof < kBodyDofCount; ++dof)
                pose.coordinates[dof] =
                    std::clamp(pose.coordinates[dof], kBodyDofs[dof].lower, kBodyDofs[dof].upper);
        return all;
    }();
    return poses;
}

}  // namespace

int key_pose_count() {
    return static_cast<int>(all_key_poses().size());
}

BodyCoordinates blended(const BodyCoordinates& from, const BodyCoordinates& to, double t) {
    const BodyPosture a = posture_from_coordinates(from);
    BodyStep step = step_between(a, posture_from_coordinates(to));
    for (double& value : step) value *= t;
    return coordinates_from_posture(stepped(a, step));
}

BodyCoordinates mirrored(const BodyCoordinates& pose) {
    BodyCoordinates q = pose;
    q[1] = -pose[1];
    for (const int ball : {static_cast<int>(kDofRootRotation), static_cast<int>(kDofSacroiliac),
                           static_cast<int>(kDofSkullbase)})
        q[ball + 1] = -pose[ball + 1], q[ball + 2] = -pose[ball + 2];
    for (int n = 0; n < kDofHipR - kDofHipL; ++n) std::swap(q[kDofHipL + n], q[kDofHipR + n]);
    return q;
}

std::vector<LibraryPose> library_poses(int count) {
    const std::vector<LibraryPose>& keys = all_key_poses();
    const std::size_t wanted = static_cast<std::size_t>(std::max(count, 0));
    std::vector<LibraryPose> poses;
    if (wanted < keys.size()) {
        for (std::size_t n = 0; n < wanted; ++n) poses.push_back(keys[n * keys.size() / wanted]);
        return poses;
    }
    poses = keys;
    Draw draw;
    const std::uint32_t pick = static_cast<std::uint32_t>(keys.size());
    while (poses.size() < wanted) {
        const LibraryPose& a = keys[draw.below(pick)];
        const LibraryPose& b = keys[draw.below(pick)];
        if (&a == &b) continue;
        if (poses.size() % 3 == 0) {
            const double t = 0.25 * (1 + draw.below(3));
            poses.push_back({a.label + " to " + b.label, blended(a.coordinates, b.coordinates, t), false});
        } else {
            poses.push_back(
                {a.label + " with arms of " + b.label, legs_and_arms(a.coordinates, b.coordinates), false});
        }
    }
    return poses;
}

}  // namespace kinevox
