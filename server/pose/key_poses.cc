#include "server/pose/key_poses.h"

#include <initializer_list>
#include <utility>

#include "common/geometry.h"

namespace kinevox {
namespace {

using Setting = std::pair<int, double>;  // degree of freedom, degrees

BodyCoordinates pose(std::initializer_list<Setting> settings) {
    BodyCoordinates q{};
    for (const auto& [dof, degrees] : settings) q[dof] = radians(degrees);
    return q;
}

constexpr int kTilt = kDofRootRotation, kLumbar = kDofSacroiliac, kNeck = kDofSkullbase;
constexpr int kArmFlexL = kDofShoulderL, kArmAddL = kDofShoulderL + 1;
constexpr int kArmFlexR = kDofShoulderR, kArmAddR = kDofShoulderR + 1;
constexpr int kHipFlexL = kDofHipL, kHipFlexR = kDofHipR, kHipAddL = kDofHipL + 1, kHipAddR = kDofHipR + 1;

std::vector<BodyCoordinates> upright_poses() {
    return {// standing, arms hanging
            pose({{kArmAddL, -10},
                  {kArmAddR, -10},
                  {kDofElbowL, 20},
                  {kDofElbowR, 20},
                  {kDofKneeL, 8},
                  {kDofKneeR, 8},
                  {kHipFlexL, 4},
                  {kHipFlexR, 4}}),
            // T-pose
            pose({{kArmAddL, -90}, {kArmAddR, -90}, {kHipAddL, -8}, {kHipAddR, -8}}),
            // standing, forearms in front
            pose({{kArmFlexL, 20},
                  {kArmFlexR, 20},
                  {kArmAddL, -15},
                  {kArmAddR, -15},
                  {kDofElbowL, 90},
                  {kDofElbowR, 90},
                  {kDofKneeL, 12},
                  {kDofKneeR, 12},
                  {kHipFlexL, 8},
                  {kHipFlexR, 8}}),
            // arms overhead
            pose({{kArmFlexL, 160}, {kArmFlexR, 160}, {kDofElbowL, 20}, {kDofElbowR, 20}}),
            // step, left leg in front, and right
            pose({{kHipFlexL, 25},
                  {kHipFlexR, -15},
                  {kDofKneeL, 10},
                  {kDofKneeR, 25},
                  {kArmFlexL, -20},
                  {kArmFlexR, 20},
                  {kDofElbowL, 25},
                  {kDofElbowR, 30},
                  {kDofAnkleR, 5}}),
            pose({{kHipFlexR, 25},
                  {kHipFlexL, -15},
                  {kDofKneeR, 10},
                  {kDofKneeL, 25},
                  {kArmFlexR, -20},
                  {kArmFlexL, 20},
                  {kDofElbowR, 25},
                  {kDofElbowL, 30},
                  {kDofAnkleL, 5}})};
}

std::vector<BodyCoordinates> crouched_poses() {
    return {// squat
            pose({{kTilt, -30},
                  {kHipFlexL, 80},
                  {kHipFlexR, 80},
                  {kDofKneeL, 90},
                  {kDofKneeR, 90},
                  {kDofAnkleL, 25},
                  {kDofAnkleR, 25},
                  {kArmFlexL, 60},
                  {kArmFlexR, 60},
                  {kDofElbowL, 30},
                  {kDofElbowR, 30},
                  {kHipAddL, -15},
                  {kHipAddR, -15}}),
            // set position of a sprint start, left and right leg in front
            pose({{kTilt, -70},
                  {kLumbar, -25},
                  {kNeck, -10},
                  {kHipFlexL, 95},
                  {kHipFlexR, 70},
                  {kDofKneeL, 85},
                  {kDofKneeR, 60},
                  {kArmFlexL, 90},
                  {kArmFlexR, 90},
                  {kDofAnkleL, 10},
                  {kDofAnkleR, 10}}),
            pose({{kTilt, -70},
                  {kLumbar, -25},
                  {kNeck, -10},
                  {kHipFlexR, 95},
                  {kHipFlexL, 70},
                  {kDofKneeR, 85},
                  {kDofKneeL, 60},
                  {kArmFlexL, 90},
                  {kArmFlexR, 90},
                  {kDofAnkleL, 10},
                  {kDofAnkleR, 10}}),
            // lunge, left leg in front, and right
            pose({{kHipFlexL, 70},
                  {kHipFlexR, -5},
                  {kDofKneeL, 75},
                  {kDofKneeR, 40},
                  {kArmFlexL, 20},
                  {kArmFlexR, 20},
                  {kDofElbowL, 70},
                  {kDofElbowR, 70},
                  {kDofAnkleR, 15}}),
            pose({{kHipFlexR, 70},
                  {kHipFlexL, -5},
                  {kDofKneeR, 75},
                  {kDofKneeL, 40},
                  {kArmFlexL, 20},
                  {kArmFlexR, 20},
                  {kDofElbowL, 70},
                  {kDofElbowR, 70},
                  {kDofAnkleL, 15}})};
}

}  // namespace

const std::vector<BodyCoordinates>& key_poses() {
    static const std::vector<BodyCoordinates> poses = [] {
        std::vector<BodyCoordinates> all = upright_poses();
        for (const BodyCoordinates& pose : crouched_poses()) all.push_back(pose);
        return all;
    }();
    return poses;
}

const std::vector<BodyCoordinates>& floor_poses() {
    static const std::vector<BodyCoordinates> poses = [] {
        constexpr int kObliquity = kDofRootRotation + 1;
        std::vector<BodyCoordinates> all;
        for (const double tilt : {90.0, -90.0}) {
            all.push_back(pose({{kTilt, tilt}, {kArmAddL, -20}, {kArmAddR, -20}}));
            all.push_back(pose({{kTilt, tilt}, {kArmFlexL, 160}, {kArmFlexR, 160}}));
        }
        all.push_back(
            pose({{kTilt, 90}, {kHipFlexL, 50}, {kHipFlexR, 50}, {kDofKneeL, 90}, {kDofKneeR, 90}}));
        for (const double side : {90.0, -90.0}) {
            all.push_back(pose({{kObliquity, side}, {kHipFlexL, 10}, {kHipFlexR, 10}}));
            all.push_back(pose(
                {{kObliquity, side}, {kHipFlexL, 60}, {kHipFlexR, 60}, {kDofKneeL, 80}, {kDofKneeR, 80}}));
        }
        all.push_back(pose({{kTilt, -80},
                            {kHipFlexL, 85},
                            {kHipFlexR, 85},
                            {kDofKneeL, 85},
                            {kDofKneeR, 85},
                            {kArmFlexL, 85},
                            {kArmFlexR, 85}}));
        all.push_back(
            pose({{kTilt, 10}, {kHipFlexL, 85}, {kHipFlexR, 85}, {kDofKneeL, 15}, {kDofKneeR, 15}}));
        all.push_back(
            pose({{kTilt, -10}, {kHipFlexL, 60}, {kHipFlexR, 60}, {kDofKneeL, 130}, {kDofKneeR, 130}}));
        return all;
    }();
    return poses;
}

BodyCoordinates with_heading(const BodyCoordinates& pose, double heading) {
    BodyCoordinates turned = pose;
    turned[kDofRootRotation + 2] += heading;  // the outermost of the root's angles
    return turned;
}

BodyCoordinates centred(const BodyModel& model, const BodyCoordinates& pose, Vec3 middle) {
    std::vector<BodyCapsule> capsules;
    model.capsules(model.forward(pose), capsules);
    Vec3 sum;
    double volume = 0;
    for (const BodyCapsule& c : capsules) {
        const Vec3 a{c.a[0], c.a[1], c.a[2]}, b{c.b[0], c.b[1], c.b[2]};
        const double radius = 0.5 * (c.radius_a + c.radius_b);
        const double part = radius * radius * (norm(b - a) + radius);
        sum += part * 0.5 * (a + b);
        volume += part;
    }
    BodyCoordinates moved = pose;
    const Vec3 by = middle - sum / volume;
    moved[0] += by.x, moved[1] += by.y, moved[2] += by.z;
    return moved;
}

}  // namespace kinevox
