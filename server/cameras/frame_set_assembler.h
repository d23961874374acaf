// Joins the pictures of cameras that are not perfect to frame sets: their clocks differ, they lose pictures,
// come late, go away and come back. Pure logic: no threads, no clock of its own.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <vector>

#include "server/cameras/camera_link.h"
#include "server/cameras/clock_estimate.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

struct FrameSetAssemblerOptions {
    std::size_t cameras = 0;
    double fps = 30;  // nominal pictures a second of each camera
    double tolerance_ms =
        0;  // pictures that are so near in time belong together; 0: half of a picture's time
    double max_wait_ms = 200;      // after its first picture's arrival a set goes out as it is
    std::size_t min_pictures = 2;  // a set with fewer is not handed out
};

struct ArrivedPicture {
    std::size_t camera = 0;
    std::uint64_t number = 0;  // counted by the camera; a gap is a lost picture. 0: it does not count
    CameraClock clock = CameraClock::kArrival;  // kUnknown: it is not known when it was taken; only with none
    std::int64_t timestamp_ns = 0;              // by that clock; of no meaning with kArrival
    std::int64_t arrival_ns = 0;                // steady clock, of the first packet
    Picture picture;                            // empty: it arrived incomplete
};

// One thread at a time. Sets come out ordered by time, their numbers rise; a jump in the numbers stands for
// sets of which nothing arrived. A set goes out when each connected camera has its picture in it, or has sent
// a later one, or max_wait_ms after it began; so one camera's loss or end delays the others by no more
// than that.
class FrameSetAssembler {
  public:
    explicit FrameSetAssembler(const FrameSetAssemblerOptions& options);

    // A camera is waited for from here on; its numbers and its clock begin anew.
    void connect(std::size_t camera);
    void disconnect(std::size_t camera);
    void add(ArrivedPicture picture);

    // The next set that is ready at `now_ns`, steady clock.
    std::optional<FrameSet> take(std::int64_t now_ns);
    // When take() will have a set even if nothing more arrives; empty: never.
    std::optional<std::int64_t> due_ns() const;

    // connected, clock, pictures, lost, incomplete, late, unmatched, settling, skew, lateness and drift.
    void fill(std::size_t camera, CameraLink& link) const;

  private:
    struct Slot {
        bool there = false;
        std::int64_t time_ns = 0, arrival_ns = 0;
        CameraClock clock = CameraClock::kUnknown;
        std::int64_t timestamp_ns = 0;
        Picture picture;
    };
    struct Pending {
        std::int64_t time_ns = 0;   // of the picture that opened it
        std::int64_t begin_ns = 0;  // its arrival, steady clock
        std::vector<Slot> slots;
    };
    struct Newest128 {
        std::deque<double> values;
        void add(double value);
        double mean() const;
        double largest() const;  // without sign
    };
    struct Lane {
        CameraLink counts;
        ClockEstimate clock;
        std::uint64_t last_number = 0;
        std::optional<std::int64_t> newest_time_ns;
        bool connected = false;
        bool in_last_set = false;  // that went out
        Newest128 skew_ms, lateness_ms;
    };

    ClockEstimate& clock_of(Lane& lane, CameraClock clock) {
        return clock == CameraClock::kPtp ? ptp_ : lane.clock;
    }
    Pending* find(std::int64_t time_ns, std::size_t camera);
    static void compare_directly(std::vector<Slot>& slots);
    bool is_ready(const Pending& set, std::int64_t now_ns) const;
    std::optional<FrameSet> finish(Pending set);

    const FrameSetAssemblerOptions options_;
    const std::int64_t period_ns_, tolerance_ns_, max_wait_ns_;
    std::vector<Lane> lanes_;
    ClockEstimate ptp_;                            // one for all cameras that keep a clock together
    std::deque<Pending> pending_;                  // by time
    std::optional<std::int64_t> last_time_ns_;     // of the set that went out last: its opening picture's
    std::optional<std::int64_t> last_capture_ns_;  // and its pictures' mean
    std::uint64_t next_sequence_ = 0;
};

}  // namespace kinevox
