#include "server/pose/body_shape.h"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <string>

#include "common/files.h"
#include "common/toml_reader.h"

namespace kinevox {

const std::array<BodyLengthInfo, kBodyLengthCount> kBodyLengths{{
    {"root_to_sacroiliac", 0.090, 0.06},
    {"sacroiliac_to_skullbase", 0.292, 0.04},
    {"skullbase_to_head_top", 0.084, 0.05},
    {"hip_half_width", 0.058, 0.06},
    {"shoulder_half_width", 0.1, 0.035},
    {"sacroiliac_to_shoulders", 0.1665, 0.035},
    {"shoulder_rise", 0.016, 0.6},
    {"upper_arm", 0.153, 0.08},
    {"forearm", 0.147, 0.05},
    {"hand", 0.11, 0.05},
    {"thigh", 0.242, 0.04},
    {"shank", 0.247, 0.035},
    {"ankle_to_toe", 0.110, 0.06},
    {"ankle_height", 0.046, 0.10},
    {"pelvis_half_width", 0.096, 0.12},
    {"pelvis_half_depth", 0.06, 0.12},
    {"pelvis_back", 0.057, 0.16},
    {"waist_half_width", 0.075, 0.12},
    {"waist_half_depth", 0.054, 0.12},
    {"waist_back", 0.030, 0.35},
    {"chest_half_width", 0.0895, 0.1},
    {"chest_half_depth", 0.0675, 0.12},
    {"chest_back", 0.058, 0.14},
    {"neck_radius", 0.029, 0.15},
    {"head_radius", 0.0505, 0.08},
    {"hair_back", 0.004, 1.2},
    {"thigh_radius", 0.0485, 0.15},
    {"knee_radius", 0.0292, 0.15},
    {"calf_radius", 0.0327, 0.15},
    {"ankle_radius", 0.019, 0.15},
    {"foot_radius", 0.0217, 0.15},
    {"upper_arm_radius", 0.03, 0.15},
    {"elbow_radius", 0.0203, 0.15},
    {"forearm_radius", 0.0225, 0.15},
    {"wrist_radius", 0.0123, 0.15},
    {"hand_radius", 0.0225, 0.15},
}};

BodyShape default_body_shape(double stature_m) {
    BodyShape shape;
    shape.stature_m = stature_m;
    for (int k = 0; k < kBodyLengthCount; ++k)
        shape.lengths_m[k] = kBodyLengths[k].fraction_of_stature * stature_m;
    return shape;
}

double girth_m(const BodyShape& shape, const BodyGirthInfo& girth) {
    const double a = shape[girth.half_width], b = shape[girth.half_depth];  // Ramanujan's ellipse
    return std::numbers::pi * (3 * (a + b) - std::sqrt((3 * a + b) * (a + 3 * b)));
}

absl::StatusOr<BodyShape> read_body_shape(const std::filesystem::path& file) {
    auto text = read_file(file);
    if (!text.ok()) return text.status();
    static constexpr RenamedKey kRenamed[] = {{"root_to_waist_m", "root_to_sacroiliac_m"},
                                              {"waist_to_skullbase_m", "sacroiliac_to_skullbase_m"},
                                              {"waist_to_shoulders_m", "sacroiliac_to_shoulders_m"},
                                              {"skullbase_to_top_m", "skullbase_to_head_top_m"}};
    auto document = TomlDocument::parse(*text, file.string(), kRenamed);
    if (!document.ok()) return document.status();
    const TomlTable root = (*document)->root();
    BodyShape shape;
    shape.stature_m = root.number("stature_m", {0.5, 2.5});
    for (int k = 0; k < kBodyLengthCount; ++k) {
        const std::string key = fmt::format("{}_m", kBodyLengths[k].name);
        const bool later = k == kPelvisBack || k == kWaistBack || k == kChestBack || k == kShoulderRise ||
                           k == kHairBack;  // absent in older files
        shape.lengths_m[k] =
            later ? root.number_or(key, kBodyLengths[k].fraction_of_stature * shape.stature_m, {0.001, 2})
                  : root.number(key, {0.001, 2});
    }
    if (absl::Status finished = (*document)->finish(); !finished.ok()) return finished;
    return shape;
}

std::string body_shape_toml(const BodyShape& shape) {
    std::string text =
        "# A subject's body: lengths between rotation centres, half-widths and radii; metres.\n";
    text += fmt::format("stature_m = {}\n", toml_number(shape.stature_m));
    for (int k = 0; k < kBodyLengthCount; ++k)
        text += fmt::format("{}_m = {}\n", kBodyLengths[k].name, toml_number(shape.lengths_m[k]));
    return text;
}

absl::Status write_body_shape(const BodyShape& shape, const std::filesystem::path& file) {
    return write_file_atomically(file, body_shape_toml(shape));
}

}  // namespace kinevox
