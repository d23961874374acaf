// The proportions of a subject: segment lengths and half-widths of the surface, including clothes.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <string_view>

namespace kinevox {

enum BodyLength : int {
    // Between rotation centres, left and right alike.
    kRootToSacroiliac,       // root to sacroiliac
    kSacroiliacToSkullbase,  // sacroiliac to skullbase
    kSkullbaseToHeadTop,     // skullbase to the top of the head
    kHipHalfWidth,           // midpoint of the hips to a hip
    kShoulderHalfWidth,      // arms hanging
    kSacroiliacToShoulders,  // height of the shoulders above the sacroiliac, arms hanging
    kShoulderRise,           // of a shoulder from hanging to raised arm
    kUpperArm,
    kForearm,
    kHand,  // wrist to the tip of the middle finger
    kThigh,
    kShank,
    kAnkleToToe,   // forwards, to the tip of the second toe
    kAnkleHeight,  // above the sole
    // Half-widths and half-depths of the trunk, radii of the limbs.
    kPelvisHalfWidth,
    kPelvisHalfDepth,
    kPelvisBack,  // from the line between the hips to the surface behind it
    kWaistHalfWidth,
    kWaistHalfDepth,
    kWaistBack,  // from the sacroiliac to the surface behind it
    kChestHalfWidth,
    kChestHalfDepth,
    kChestBack,  // from the spine's axis to the surface behind it
    kNeckRadius,
    kHeadRadius,
    kHairBack,     // how far long hair, a knot or a tail extends behind the head; short hair: < 1 cm
    kThighRadius,  // a quarter of the way from hip to knee
    kKneeRadius,
    kCalfRadius,
    kAnkleRadius,
    kFootRadius,
    kUpperArmRadius,  // a quarter of the way from shoulder to elbow
    kElbowRadius,
    kForearmRadius,  // a quarter of the way from elbow to wrist
    kWristRadius,
    kHandRadius,
    kBodyLengthCount
};

struct BodyLengthInfo {
    std::string_view name;       // as in body.toml, there with the suffix _m
    double fraction_of_stature;  // the default
    double relative_std;         // between persons of the same stature: the prior of a fit
};
// Lengths: means of both sexes after de Leva (1996, joint centres) and Drillis & Contini (1966, as in Winter,
// Biomechanics and Motor Control of Human Movement, table 4.1), hip and shoulder centres moved from the bony
// landmarks to the rotation centres. Widths and radii between the girths of Gordon et al. (ANSUR, 1988) with
// a centimetre of clothes and those that fit the clothed meshes of the test data with this surface.
extern const std::array<BodyLengthInfo, kBodyLengthCount> kBodyLengths;

struct BodyShape {
    double stature_m = 1.72;
    std::array<double, kBodyLengthCount> lengths_m{};

    double operator[](BodyLength which) const { return lengths_m[which]; }
    double& operator[](BodyLength which) { return lengths_m[which]; }
    bool operator==(const BodyShape&) const = default;
};

// Of a subject the body that its poses are measured with; of 0, that of the next subject. Null: none is.
using BodyOf = std::function<const BodyShape*(std::uint32_t subject_id)>;

// Circumferences from the half-widths and radii, as by a tape measure.
struct BodyGirthInfo {
    std::string_view name;
    BodyLength half_width, half_depth;  // the same for a limb
};
inline constexpr std::array<BodyGirthInfo, 12> kBodyGirths{{
    {"pelvis", kPelvisHalfWidth, kPelvisHalfDepth},
    {"waist", kWaistHalfWidth, kWaistHalfDepth},
    {"chest", kChestHalfWidth, kChestHalfDepth},
    {"neck", kNeckRadius, kNeckRadius},
    {"thigh", kThighRadius, kThighRadius},
    {"knee", kKneeRadius, kKneeRadius},
    {"calf", kCalfRadius, kCalfRadius},
    {"ankle", kAnkleRadius, kAnkleRadius},
    {"upper_arm", kUpperArmRadius, kUpperArmRadius},
    {"elbow", kElbowRadius, kElbowRadius},
    {"forearm", kForearmRadius, kForearmRadius},
    {"wrist", kWristRadius, kWristRadius},
}};
double girth_m(const BodyShape& shape, const BodyGirthInfo& girth);

// The average person of that stature, 0.5 to 2.5 m.
BodyShape default_body_shape(double stature_m = 1.72);

// body.toml. Reading is strict: every length must be there and positive.
absl::StatusOr<BodyShape> read_body_shape(const std::filesystem::path& file);
std::string body_shape_toml(const BodyShape& shape);
absl::Status write_body_shape(const BodyShape& shape, const std::filesystem::path& file);

}  // namespace kinevox
