// Progress of a job in one line, which is erased at the end.
#pragma once

#include <chrono>
#include <string_view>

namespace kinevox {

// On standard error, at most ten times per second, and only if that is a terminal.
class ProgressLine {
  public:
    explicit ProgressLine(bool quiet = false);
    ~ProgressLine() { clear(); }
    ProgressLine(const ProgressLine&) = delete;
    ProgressLine& operator=(const ProgressLine&) = delete;

    bool due();                        // time to draw
    void draw(std::string_view text);  // at once
    void show(double progress);        // "42 %" of 0 to 1, if due
    void clear();

  private:
    bool on_, shown_ = false;
    std::chrono::steady_clock::time_point drawn_{};
};

}  // namespace kinevox
