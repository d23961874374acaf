// What a camera's clock shows, as this machine's steady clock: offset and drift from the pictures themselves.
#pragma once

#include <cstdint>
#include <deque>

namespace kinevox {

// A picture arrives some delay after it was taken, never before. The smallest delays are nearly constant, the
// others are what network and scheduler add; so the line below all points (timestamp, arrival - timestamp)
// that runs closest to them tells offset and drift. Times come out later than the truth by that smallest
// delay, by the same amount for cameras of one kind. One thread at a time.
class ClockEstimate {
  public:
    // Takes a picture's timestamp (the camera's clock, ns, any zero) and its arrival (steady clock, ns) into
    // account and returns when it was taken, on the steady clock, not behind `arrival_ns`. A clock that jumps
    // is learned anew.
    std::int64_t add(std::int64_t timestamp_ns, std::int64_t arrival_ns);

    // Enough pictures have been seen for the offset to be better than the delays' scatter.
    bool settled() const { return samples_ >= kSettled; }
    double drift_ppm() const { return drift_ * 1e6; }  // of the camera's clock: positive, it runs fast
    void reset() { *this = ClockEstimate(); }

    static constexpr int kSettled = 8;

  private:
    struct Point {
        double timestamp_s = 0, offset_s = 0;  // against the first sample's
    };
    void close_window();
    double offset_at(double timestamp_s) const;

    int samples_ = 0;
    std::int64_t timestamp_0_ns_ = 0, arrival_0_ns_ = 0;
    std::int64_t last_timestamp_ns_ = 0;
    double window_begin_s_ = 0;
    Point lowest_;               // of the window under way
    std::deque<Point> windows_;  // the lowest of each window before it
    bool fitted_ = false;
    Point anchor_;      // of the fitted line
    double slope_ = 0;  // of the offset
    double drift_ = 0;
};

}  // namespace kinevox
