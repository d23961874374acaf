#include <fmt/format.h>

#include <cmath>
#include <iterator>

#include "common/degrees.h"
#include "server/recording/trial_formats.h"

namespace kinevox {

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
