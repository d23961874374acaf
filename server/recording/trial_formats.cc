#include "server/recording/trial_formats.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

#include "common/geometry.h"
#include "common/one_line.h"

namespace kinevox {
namespace {

constexpr double kTurn = 2 * std::numbers::pi;

double turned_to(double angle, double previous) {
    return previous + std::remainder(angle - previous, kTurn);
}

double distance(const EulerAngles& a, const EulerAngles& b) {
    return std::abs(a[0] - b[0]) + std::abs(a[1] - b[1]) + std::abs(a[2] - b[2]);
}

Mat3 about(Axis axis, double angle) {
    return axis == kAxisX ? rotation_x(angle) : axis == kAxisY ? rotation_y(angle) : rotation_z(angle);
}

}  // namespace

EulerAngles euler_from_rotation(const Mat3& r, const EulerOrder& order) {
    const auto [i, j, k] = order;
    const double sign = (i + 1) % 3 == j ? 1 : -1;  // of the permutation
    const double sine = std::clamp(sign * r(i, k), -1.0, 1.0);
    constexpr double kSingular = 1 - 1e-12;
    if (std::abs(sine) > kSingular) return {std::atan2(sign * r(k, j), r(j, j)), std::asin(sine), 0};
    return {std::atan2(-sign * r(j, k), r(k, k)), std::asin(sine), std::atan2(-sign * r(i, j), r(i, i))};
}

Mat3 rotation_from_euler(const EulerAngles& angles, const EulerOrder& order) {
    return about(order[0], angles[0]) * about(order[1], angles[1]) * about(order[2], angles[2]);
}

EulerAngles nearest_euler(const EulerAngles& angles, const EulerAngles& previous) {
    EulerAngles same, other;
    for (int n = 0; n < 3; ++n) {
        same[n] = turned_to(angles[n], previous[n]);
        const double mirrored = n == 1 ? std::numbers::pi - angles[n] : angles[n] + std::numbers::pi;
        other[n] = turned_to(mirrored, previous[n]);
    }
    return distance(other, previous) < distance(same, previous) - 1e-9 ? other : same;
}

// TRC: markers as text for OpenSim: tab-separated, NaN for missing markers (its older releases merge adjacent
// tabs), frames from 1.

std::string trc_file(const Trial& trial, const std::string& file_name) {
    std::string text = fmt::format("PathFileType\t4\t(X/Y/Z)\t{}\n", one_line(file_name));
    text +=
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\tOrigDataStartFrame\tOrigNumFrames"
        "\n";
    const auto put = [&text]<class... T>(fmt::format_string<T...> format, T&&... values) {
        fmt::format_to(std::back_inserter(text), format, std::forward<T>(values)...);
    };
    put("{0:.6g}\t{0:.6g}\t{1}\t{2}\tmm\t{0:.6g}\t1\t{1}\n", trial.rate_hz, trial.size(), kJointNames.size());
    text += "Frame#\tTime";
    for (std::size_t j = 0; j < kJointNames.size(); ++j)
        put("\t{}{}", kJointNames[j], j + 1 < kJointNames.size() ? "\t\t" : "");
    text += "\n\t";
    for (std::size_t j = 1; j <= kJointNames.size(); ++j) put("\tX{0}\tY{0}\tZ{0}", j);
    text += "\n\n";
    for (std::size_t n = 0; n < trial.size(); ++n) {
        put("{}\t{:.6f}", n + 1, trial.time_s[n]);
        for (const Vec3& p : trial.joints[n]) {
            if (std::isnan(p.x))
                text += "\tNaN\tNaN\tNaN";
            else
                put("\t{:.3f}\t{:.3f}\t{:.3f}", 1000 * p.x, 1000 * p.z, -1000 * p.y);
        }
        text += '\n';
    }
    return text;
}

std::string csv_file(const Trial& trial) {
    std::string text = "frame,time_s";
    const auto put = [&text]<class... T>(fmt::format_string<T...> format, T&&... values) {
        fmt::format_to(std::back_inserter(text), format, std::forward<T>(values)...);
    };
    for (const std::string_view joint : kJointNames) put(",{0}_x_m,{0}_y_m,{0}_z_m", joint);
    if (!trial.angles_rad.empty())
        for (const std::string_view angle : kJointAngleNames) put(",{}_deg", angle);
    if (!trial.coordinates.empty())
        for (int d = 0; d < kBodyDofCount; ++d)
            put(",{}_{}", kBodyDofs[d].name, is_position(d) ? "m" : "deg");
    const auto put_value = [&](double value, int digits) {
        text += ',';
        if (!std::isnan(value)) put("{:.{}f}", value, digits);
    };
    for (std::size_t n = 0; n < trial.size(); ++n) {
        put("\n{},{:.6f}", trial.frames[n], trial.time_s[n]);
        for (const Vec3& p : trial.joints[n])
            for (const double value : {p.x, p.y, p.z}) put_value(value, 5);
        if (!trial.angles_rad.empty())
            for (const double angle : trial.angles_rad[n]) put_value(degrees(angle), 4);
        if (!trial.coordinates.empty())
            for (int d = 0; d < kBodyDofCount; ++d)
                put_value(is_position(d) ? trial.coordinates[n][d] : degrees(trial.coordinates[n][d]),
                          is_position(d) ? 5 : 4);
    }
    return text + '\n';
}

}  // namespace kinevox
