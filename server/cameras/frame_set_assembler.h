// Joins images of several cameras into frame sets, tolerating clock offsets, lost and late images,
// disconnections and reconnections. Pure logic: no threads, no clock of its own.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "server/cameras/camera_connection.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

// Converts a camera's clock to this machine's steady clock; estimates offset and drift from image arrivals.
//
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

struct FrameSetAssemblerOptions {
    std::size_t camera_count = 0;
    double fps = 30;                // nominal, of each camera
    double match_tolerance_ms = 0;  // maximum time difference within a set; 0: half a frame period
    double max_wait_ms = 200;    // from the arrival of its first image until a set is handed out incomplete
    std::size_t min_images = 2;  // sets with fewer are dropped
};

struct ArrivedImage {
    std::size_t camera = 0;
    std::uint64_t number = 0;  // assigned by the camera, gaps are lost images; 0: not numbered
    // kUnknown: capture time unknown; only where the image is empty
    TimestampSource clock = TimestampSource::kArrival;
    std::int64_t timestamp_ns = 0;  // on that clock; unused with kArrival
    std::int64_t arrival_ns = 0;    // steady clock, of the first packet
    Image image;                    // empty: it arrived incomplete
};

// One thread at a time. Sets are handed out in the order of time, with rising sequence numbers; a gap stands
// for sets of which nothing arrived. A set is handed out when each connected camera has contributed or has
// sent a later image, at the latest after max_wait_ms; so losses and disconnections delay the others by no
// more.
class FrameSetAssembler {
  public:
    explicit FrameSetAssembler(const FrameSetAssemblerOptions& options);

    // Sets wait for this camera from now on; its image numbers and clock estimate are reset.
    void connect(std::size_t camera);
    void disconnect(std::size_t camera);
    void add(ArrivedImage image);

    // The next set that is ready at `now_ns`, steady clock.
    std::optional<FrameSet> take(std::int64_t now_ns);
    // When take() returns a set even if nothing more arrives; empty: never.
    std::optional<std::int64_t> due_ns() const;

    // Fills in connected, timestamp_source, the image counts, skew, arrival delay and drift.
    void fill(std::size_t camera, CameraConnection& link) const;

  private:
    struct Slot {
        bool there = false;
        std::int64_t time_ns = 0, arrival_ns = 0;
        TimestampSource clock = TimestampSource::kUnknown;
        std::int64_t timestamp_ns = 0;
        Image image;
    };
    struct Pending {
        std::int64_t time_ns = 0;   // of the image that opened it
        std::int64_t begin_ns = 0;  // its arrival, steady clock
        std::vector<Slot> slots;
    };
    struct Latest128 {
        std::deque<double> values;
        void add(double value);
        double mean() const;
        double max_abs() const;
    };
    struct Lane {
        CameraConnection counts;
        ClockEstimate clock;
        std::uint64_t last_number = 0;
        std::optional<std::int64_t> latest_time_ns;
        bool connected = false;
        bool in_last_set = false;  // of the sets handed out
        Latest128 skew_ms, lateness_ms;
    };

    ClockEstimate& clock_of(Lane& lane, TimestampSource clock) {
        return clock == TimestampSource::kPtp ? ptp_ : lane.clock;
    }
    Pending* find(std::int64_t time_ns, std::size_t camera);
    static void compare_directly(std::vector<Slot>& slots);
    bool is_ready(const Pending& set, std::int64_t now_ns) const;
    std::optional<FrameSet> finish(Pending set);

    const FrameSetAssemblerOptions options_;
    const std::int64_t period_ns_, tolerance_ns_, max_wait_ns_;
    std::vector<Lane> lanes_;
    ClockEstimate ptp_;                            // shared by all cameras synchronised by PTP
    std::deque<Pending> pending_;                  // by time
    std::optional<std::int64_t> last_time_ns_;     // of the set handed out last: that of its first image
    std::optional<std::int64_t> last_capture_ns_;  // and the mean of its images
    std::uint64_t next_sequence_ = 0;
};

}  // namespace kinevox
