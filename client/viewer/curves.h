// The latest seconds of all angles, for curves and numbers, and the marks in the curves. No Qt.
#pragma once

#include <cstdint>
#include <deque>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "client/viewer/shown.h"
#include "kinevox/v1/capture_service.pb.h"

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

// In the curves: events of the daemon and marks of the user.
struct PlotMark {
    std::int64_t time_ns = 0;  // UTC, on the clock of the poses' capture times
    std::string text;
    bool by_user = false;
    std::uint32_t subject_id = 0;  // 0: of none
};

class PlotMarks {
  public:
    static constexpr std::size_t kMaxMarks = 256;

    void clear();
    // Ignores kinds that are irrelevant for curves.
    void add_event(v1::EventKind kind, std::int64_t time_ns, std::uint32_t subject_id = 0);
    // Returns the number of the mark.
    int add_mark(std::int64_t time_ns);
    // Inclusive.
    std::vector<PlotMark> between(std::int64_t first_ns, std::int64_t last_ns) const;

  private:
    void add(PlotMark mark);

    std::deque<PlotMark> marks_;  // in order of arrival
    int count_ = 0;               // of marks of the user
};

}  // namespace kinevox::viewer
