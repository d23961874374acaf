// Converts a camera's clock to this machine's steady clock; estimates offset and drift from image arrivals.
#pragma once

#include <cstdint>
#include <deque>

namespace kinevox {

// An image arrives some delay after its capture. The minimum delay is nearly constant; network and scheduler
// add the rest. So offset and drift are those of the line that runs closest below all points (timestamp,
// arrival - timestamp). Estimated times are late by the minimum delay, which is the same for cameras of one
// model. One thread at a time.
class ClockEstimate {
  public:
    // Adds an image's timestamp (camera clock, ns, arbitrary zero) and arrival (steady clock, ns); returns
    // its capture time on the steady clock, not after `arrival_ns`. The estimate is reset when the clock
    // jumps.
    std::int64_t add(std::int64_t timestamp_ns, std::int64_t arrival_ns);

    // Enough images for an offset error below the scatter of the delays.
    bool settled() const { return samples_ >= kSettled; }
    double drift_ppm() const { return drift_ * 1e6; }  // positive: the camera's clock runs fast
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
    Point lowest_;               // of the current window
    std::deque<Point> windows_;  // the lowest of each previous window
    bool fitted_ = false;
    Point anchor_;      // of the fitted line
    double slope_ = 0;  // of the offset
    double drift_ = 0;
};

}  // namespace kinevox
