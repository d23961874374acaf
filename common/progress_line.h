// How far a work is, in one line that goes when it ends.
#pragma once

#include <chrono>
#include <string_view>

namespace kinevox {

// On standard error, at most ten times a second, and only if that is a terminal.
class ProgressLine {
  public:
    explicit ProgressLine(bool quiet = false);
    ~ProgressLine() { clear(); }
    ProgressLine(const ProgressLine&) = delete;
    ProgressLine& operator=(const ProgressLine&) = delete;

    bool due();                        // whether it is time to draw
    void draw(std::string_view text);  // where it is due
    void show(double share);           // "42 %" of 0 to 1, if it is due
    void clear();

  private:
    bool on_, shown_ = false;
    std::chrono::steady_clock::time_point drawn_{};
};

}  // namespace kinevox
