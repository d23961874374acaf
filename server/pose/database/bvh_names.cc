#include "server/pose/database/bvh_names.h"

#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <initializer_list>
#include <string_view>

namespace kinevox {
namespace {

bool lower(char c) {
    return std::islower(static_cast<unsigned char>(c)) != 0;
}
bool upper(char c) {
    return std::isupper(static_cast<unsigned char>(c)) != 0;
}

struct Name {
    std::string base;  // lower case letters and digits, without the side and a name space
    char side = 0;     // 'l', 'r' or 0
};

Name split_name(std::string name) {
    if (const auto colon = name.rfind(':'); colon != std::string::npos) name.erase(0, colon + 1);
    for (const std::string_view prefix :
         {"mixamorig_", "mixamorig", "Bip01 ", "Bip01_", "CC_Base_", "def_", "DEF-"})
        if (name.size() > prefix.size() && name.compare(0, prefix.size(), prefix) == 0)
            name.erase(0, prefix.size());
    Name out;
    // "L_Thigh", "thigh.L", "lThigh", "LThumb"; the longer words follow below.
    const auto is_side = [](char c) { return c == 'l' || c == 'r' || c == 'L' || c == 'R'; };
    const auto is_gap = [](char c) { return c == '_' || c == '.' || c == '-' || c == ' '; };
    const auto take = [&](char c) {
        out.side = static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    };
    const std::size_t n = name.size();
    if (n > 2 && is_gap(name[n - 2]) && is_side(name[n - 1])) {
        take(name[n - 1]);
        name.erase(n - 2);
    } else if (n > 2 && is_side(name[0]) && is_gap(name[1])) {
        take(name[0]);
        name.erase(0, 2);
    } else if (n > 2 && is_side(name[0]) && upper(name[1]) && lower(name[2])) {
        take(name[0]);
        name.erase(0, 1);
    }
    for (const char c : name)
        if (std::isalnum(static_cast<unsigned char>(c)))
            out.base += static_cast<char>(std::tolower(static_cast<unsigned char>(c)));
    for (const auto& [word, side] :
         {std::pair{std::string_view("left"), 'l'}, {std::string_view("right"), 'r'}}) {
        const auto at = out.base.find(word);
        if (out.side || at == std::string::npos || out.base.size() == word.size()) continue;
        if (at != 0 && at + word.size() != out.base.size()) continue;
        out.base.erase(at, word.size());
        out.side = side;
    }
    return out;
}

bool is_one_of(const std::string& base, std::initializer_list<std::string_view> names) {
    return std::find(names.begin(), names.end(), base) != names.end();
}
bool contains_one_of(const std::string& base, std::initializer_list<std::string_view> parts) {
    return std::any_of(parts.begin(), parts.end(),
                       [&](std::string_view part) { return base.find(part) != std::string::npos; });
}

constexpr int kKnownButUnused = -1, kUnknown = -2;

// The role of the left joint, for both sides.
int limb_role(const std::string& base, bool arms_are_called_arms) {
    if (contains_one_of(base, {"thumb", "index", "middle", "ring", "pinky", "finger", "metacarpal", "palm",
                               "handend", "toeend", "footend", "eye"}))
        return kKnownButUnused;
    if (is_one_of(base, {"collar", "clavicle", "hipjoint", "buttock", "breast", "clavicula"}))
        return kKnownButUnused;
    if (base == "shoulder") return arms_are_called_arms ? kKnownButUnused : static_cast<int>(kBvhShoulderL);
    if (is_one_of(base, {"upleg", "thigh", "hip", "upperleg", "femur", "upperleg01"})) return kBvhHipL;
    if (is_one_of(base, {"leg", "shin", "knee", "lowleg", "lowerleg", "calf", "tibia", "lowerleg01"}))
        return kBvhKneeL;
    if (is_one_of(base, {"foot", "ankle"})) return kBvhAnkleL;
    if (is_one_of(base, {"toebase", "toe", "toes", "ball", "toe0"})) return kBvhToeL;
    if (is_one_of(base, {"arm", "uparm", "upperarm", "humerus", "upperarm01"})) return kBvhShoulderL;
    if (is_one_of(base, {"forearm", "lowarm", "lowerarm", "elbow", "radius", "lowerarm01"}))
        return kBvhElbowL;
    if (is_one_of(base, {"hand", "wrist"})) return kBvhWristL;
    if (contains_one_of(
            base, {"twist", "roll", "upperleg02", "lowerleg02", "upperarm02", "lowerarm02", "shoulder01"}))
        return kKnownButUnused;
    return kUnknown;
}

int middle_role(const std::string& base) {
    if (is_one_of(base, {"hips", "hip", "pelvis", "root"})) return kBvhRoot;
    if (contains_one_of(base,
                        {"spine", "chest", "torso", "thorax", "back", "abdomen", "waist", "sacroiliac"}))
        return kBvhSpine;
    if (contains_one_of(base, {"neck", "skullbase"})) return kBvhNeck;
    if (base == "head") return kBvhHead;
    if (contains_one_of(base, {"head", "jaw", "eye", "tongue"})) return kKnownButUnused;
    return kUnknown;
}

std::string listed(const std::vector<std::string>& names) {
    std::string out;
    for (std::size_t n = 0; n < std::min<std::size_t>(names.size(), 12); ++n)
        out += fmt::format("{}'{}'", n ? ", " : "", names[n]);
    if (names.size() > 12) out += fmt::format(" and {} more", names.size() - 12);
    return out;
}

}  // namespace

absl::StatusOr<std::array<int, kBvhRoleCount>> bvh_roles(const std::vector<BvhJoint>& joints) {
    std::array<int, kBvhRoleCount> roles;
    roles.fill(-1);
    bool arms = false;
    for (const BvhJoint& joint : joints) {
        const Name name = split_name(joint.name);
        arms |= name.side && is_one_of(name.base, {"arm", "uparm", "upperarm", "humerus", "upperarm01"});
    }
    std::vector<std::string> unknown;
    for (std::size_t n = 0; n < joints.size(); ++n) {
        const Name name = split_name(joints[n].name);
        int role = name.side ? limb_role(name.base, arms) : middle_role(name.base);
        if (role == kUnknown) unknown.push_back(joints[n].name);
        if (role < 0) continue;
        if (name.side == 'r') role += kBvhHipR - kBvhHipL;
        if (roles[role] < 0) roles[role] = static_cast<int>(n);  // the first of several, nearest to the root
    }
    if (roles[kBvhRoot] < 0 && !joints.empty()) roles[kBvhRoot] = 0;
    if (!unknown.empty())
        return absl::InvalidArgumentError(
            fmt::format("unknown joints: {}; rename them to hips, spine, neck, head, and with left or right: "
                        "thigh, shin, "
                        "foot, toe, collar, upper arm, forearm, hand",
                        listed(unknown)));
    static constexpr std::array<std::string_view, kBvhRoleCount> kNames{"hips",
                                                                        "",
                                                                        "neck or head",
                                                                        "",
                                                                        "left thigh",
                                                                        "left shin",
                                                                        "left foot",
                                                                        "",
                                                                        "left upper arm",
                                                                        "left forearm",
                                                                        "left hand",
                                                                        "right thigh",
                                                                        "right shin",
                                                                        "right foot",
                                                                        "",
                                                                        "right upper arm",
                                                                        "right forearm",
                                                                        "right hand"};
    if (roles[kBvhNeck] < 0) roles[kBvhNeck] = roles[kBvhHead];
    std::vector<std::string> missing;
    for (int role = 0; role < kBvhRoleCount; ++role)
        if (roles[role] < 0 && !kNames[role].empty()) missing.emplace_back(kNames[role]);
    if (!missing.empty())
        return absl::InvalidArgumentError(fmt::format("missing joints: {}", listed(missing)));
    return roles;
}

}  // namespace kinevox
