// TRC: markers as text for OpenSim: tab-separated, NaN for missing markers (its older releases merge adjacent
// tabs), frames from 1.
#include <fmt/format.h>

#include <cmath>
#include <iterator>

#include "common/one_line.h"
#include "server/recording/trial_formats.h"

namespace kinevox {

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

}  // namespace kinevox
