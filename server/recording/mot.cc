// MOT: model coordinates as text for OpenSim.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <numbers>

#include "common/geometry.h"
#include "common/one_line.h"
#include "server/recording/trial_formats.h"

namespace kinevox {
namespace {

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

// OpenSim's axes: x forward, y up, z right.
constexpr Mat3 kOpenSimFromWorld{{1, 0, 0, 0, 0, 1, 0, -1, 0}};
constexpr EulerOrder kPelvisOrder{kAxisZ, kAxisX, kAxisY};  // tilt, list, rotation
// Rajagopal2016.osim, stature 1.70 m: from the midpoint of the hip joints to the pelvis' origin, in its axes.
constexpr double kModelStature_m = 1.70;
constexpr Vec3 kOriginFromHips{0.056276, 0.07849, 0};

Mat3 pelvis_in_opensim(const BodyCoordinates& q) {
    const Mat3 world_from_pelvis = posture_from_coordinates(q).parent_from_segment[kPelvis];
    return kOpenSimFromWorld * world_from_pelvis * kOpenSimFromWorld.transposed();
}

// Tilt, list, rotation, without jumps; NaN where withheld.
std::vector<EulerAngles> pelvis_angles(const Trial& trial) {
    std::vector<EulerAngles> out;
    EulerAngles last{};
    bool any = false;
    for (const BodyCoordinates& q : trial.coordinates) {
        if (std::isnan(q[kDofRootRotation])) {
            out.push_back({kNaN, kNaN, kNaN});
            continue;
        }
        EulerAngles angles = euler_from_rotation(pelvis_in_opensim(q), kPelvisOrder);
        if (any)
            for (int k = 0; k < 3; ++k)
                angles[k] = last[k] + std::remainder(angles[k] - last[k], 2 * std::numbers::pi);
        any = true;
        out.push_back(last = angles);
    }
    return out;
}

Vec3 pelvis_origin(const Trial& trial, const BodyModel& model, std::size_t n) {
    const BodyCoordinates& q = trial.coordinates[n];
    const Vec3 root = kOpenSimFromWorld * Vec3{q[0], q[1], q[2]};
    const Mat3 pelvis = pelvis_in_opensim(q);
    const Vec3 hips = 0.5 * (model.offset_in_parent(kThighL) + model.offset_in_parent(kThighR));
    const double scale = trial.body->stature_m / kModelStature_m;
    return root + pelvis * (kOpenSimFromWorld * hips + scale * kOriginFromHips);
}

}  // namespace

absl::StatusOr<std::string> mot_file(const Trial& trial) {
    if (absl::Status complete = needs_coordinates_and_body(trial, "MOT"); !complete.ok()) return complete;
    const BodyModel model(*trial.body);
    const std::vector<EulerAngles> pelvis = pelvis_angles(trial);
    std::string text = trial.name;
    if (!trial.subject_name.empty()) text += ", " + trial.subject_name;
    text = one_line(std::move(text));
    std::erase(text, '=');  // OpenSim reads a line with '=' as key and value
    const auto put = [&text]<class... T>(fmt::format_string<T...> format, T&&... values) {
        fmt::format_to(std::back_inserter(text), format, std::forward<T>(values)...);
    };
    put("\nversion=1\nnRows={}\nnColumns={}\ninDegrees=yes\n\n", trial.size(), 1 + kBodyDofCount);
    text += "Coordinates by the names of Rajagopal2016.osim; it has none for the neck. Metres and degrees.\n";
    text += "The pelvis' origin is set by that model's proportions at the subject's stature.\n";
    text += "endheader\ntime";
    for (const std::string_view name : kOpenSimPelvisNames) put("\t{}", name);
    for (int d = kDofSacroiliac; d < kBodyDofCount; ++d) put("\t{}", kBodyDofs[d].name);
    text += '\n';
    const auto put_value = [&](double value) {
        if (std::isnan(value))
            text += "\tNaN";
        else
            put("\t{:.6f}", value);
    };
    for (std::size_t n = 0; n < trial.size(); ++n) {
        put("{:.6f}", trial.time_s[n]);
        for (const double angle : pelvis[n]) put_value(degrees(angle));
        const Vec3 origin = pelvis_origin(trial, model, n);
        for (const double position : {origin.x, origin.y, origin.z}) put_value(position);
        for (int d = kDofSacroiliac; d < kBodyDofCount; ++d) put_value(degrees(trial.coordinates[n][d]));
        text += '\n';
    }
    return text;
}

AngleRange mot_pelvis_rotation(const Trial& trial) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    AngleRange range{kInfinity, -kInfinity};
    for (const EulerAngles& angles : pelvis_angles(trial))
        if (!std::isnan(angles[2]))
            range = {std::min(range.min_rad, angles[2]), std::max(range.max_rad, angles[2])};
    return range.min_rad <= range.max_rad ? range : AngleRange{};
}

}  // namespace kinevox
