// The newest seconds of all angles, for curves and numbers.
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
    static constexpr int kKept_s = 30;

    // Poses in the order in which they came. One whose time is not after the newest's, as after a seek, or
    // more than kKept_s after it, begins anew.
    void add(const ShownPose& pose);
    void clear();

    struct Series {
        std::vector<double> time_s;     // before the newest: 0 or less
        std::vector<double> value_deg;  // NaN: withheld, nobody tracked
    };
    Series series(const std::string& angle) const;
    // Of the newest pose; nothing where it is withheld.
    std::optional<double> newest_deg(const std::string& angle) const;
    std::optional<std::int64_t> newest_time_ns() const;
    // As they came, in their order.
    std::vector<std::string> names() const { return names_; }
    // The other side's: knee_flexion_l for knee_flexion_r; empty for an angle of the middle.
    static std::string other_side(const std::string& angle);
    // left / right of the newest pose; nothing where one is withheld or the right is under 5 degrees, where a
    // ratio says nothing.
    std::optional<double> left_over_right(const std::string& angle) const;

  private:
    struct Instant {
        std::int64_t time_ns = 0;
        std::vector<float> value_deg;  // in the order of names_
    };
    std::vector<std::string> names_;
    std::map<std::string, std::size_t> places_;
    std::deque<Instant> instants_;
};

}  // namespace kinevox::viewer
