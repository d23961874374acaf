// Marks in the curves: events of the daemon and marks of the user. No Qt.
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
    bool by_user = false;
};

class PlotMarks {
  public:
    static constexpr std::size_t kMaxMarks = 256;

    void clear();
    // Ignores kinds that are irrelevant for curves.
    void add_event(v1::EventKind kind, std::int64_t time_ns);
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
