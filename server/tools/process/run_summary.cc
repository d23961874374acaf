#include "server/tools/process/run_summary.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace kinevox {

double quantile(std::vector<double> values, double q) {
    if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
    const auto rank =
        static_cast<std::size_t>(std::max(0.0, std::ceil(q * static_cast<double>(values.size())) - 1));
    std::nth_element(values.begin(), values.begin() + static_cast<std::ptrdiff_t>(rank), values.end());
    return values[rank];
}

void RunSummary::add(const FrameResult& result) {
    times_.push_back(result.times);
    if (result.volume) litres_.push_back(volume_litres(*result.volume));
}

std::string RunSummary::text(double wall_s) const {
    struct Row {
        const char* name;
        double StageTimes::*value;
    };
    static constexpr std::array kRows{Row{"segmentation", &StageTimes::segmentation_ms},
                                      Row{"tracking", &StageTimes::tracking_ms},
                                      Row{"hull", &StageTimes::hull_ms},
                                      Row{"colouring", &StageTimes::colouring_ms},
                                      Row{"pose", &StageTimes::pose_ms},
                                      Row{"total", &StageTimes::total_ms},
                                      Row{"(decoding)", &StageTimes::decode_ms}};
    std::string out =
        fmt::format("{} frame sets in {:.1f} s ({:.1f} per second), {} with a volume\n", frames(), wall_s,
                    static_cast<double>(frames()) / std::max(wall_s, 1e-9), litres_.size());
    if (!litres_.empty())
        out += fmt::format("volume {:.1f} to {:.1f} litres, median {:.1f}\n", quantile(litres_, 0),
                           quantile(litres_, 1), quantile(litres_, 0.5));
    out += fmt::format("{:<14}{:>10}{:>10}\n", "ms", "median", "p99");
    for (const Row& row : kRows) {
        std::vector<double> values;
        for (const StageTimes& times : times_) values.push_back(times.*row.value);
        out += fmt::format("{:<14}{:>10.3f}{:>10.3f}\n", row.name, quantile(values, 0.5),
                           quantile(values, 0.99));
    }
    return out;
}

}  // namespace kinevox
