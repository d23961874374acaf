// The latest seconds of all angles, for curves and numbers.
#pragma once

#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "client/viewer/shown.h"

namespace kinevox::viewer {

class AngleHistory {
  public:
    static constexpr int kMaxAge_s = 30;

    // Appends a pose. A time that is not after the latest, as after a seek, or more than kMaxAge_s after it,
    // clears the history first.
    void add(const ShownPose& pose);
    void clear();

    struct Series {
        std::vector<double> time_s;     // relative to the latest: 0 or less
        std::vector<double> value_deg;  // NaN: withheld, no subject
    };
    Series series(const std::string& angle) const;
    // Of the latest pose; empty if withheld.
    std::optional<double> latest_deg(const std::string& angle) const;
    std::optional<std::int64_t> latest_time_ns() const;
    // In the order of the poses.
    std::vector<std::string> names() const { return names_; }
    // knee_flexion_geometric_l for knee_flexion_geometric_r; empty for an angle of the midline.
    static std::string opposite_side(const std::string& angle);
    // left / right of the latest pose; empty if one is withheld, or if the right one is under 5 degrees,
    // where a ratio is meaningless.
    std::optional<double> left_over_right(const std::string& angle) const;

  private:
    struct Instant {
        std::int64_t time_ns = 0;
        std::vector<float> value_deg;  // in the order of names_
    };
    std::vector<std::string> names_;
    std::map<std::string, std::size_t> index_;
    std::deque<Instant> instants_;
};

}  // namespace kinevox::viewer
