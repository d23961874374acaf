// Moments worth a line in the curves: what the daemon told and what the coach marked. No Qt.
#pragma once

#include <cstdint>
#include <deque>
#include <string>
#include <vector>

#include "kinevox/v1/capture_service.pb.h"

namespace kinevox::viewer {

struct PlotMark {
    std::int64_t time_ns = 0;  // UTC, on the clock of the poses' capture times
    std::string text;
    bool coach = false;
};

class PlotMarks {
  public:
    static constexpr std::size_t kMost = 256;

    void clear();
    // Of those kinds that a curve is read with; others are left out.
    void add_event(v1::EventKind kind, std::int64_t time_ns);
    // Numbered; its number.
    int add_mark(std::int64_t time_ns);
    // Both ends included.
    std::vector<PlotMark> between(std::int64_t first_ns, std::int64_t last_ns) const;

  private:
    void add(PlotMark mark);

    std::deque<PlotMark> marks_;  // in the order in which they came
    int count_ = 0;               // of the coach's
};

}  // namespace kinevox::viewer
