// What is counted while the capture runs, for the metrics; all else is asked for when somebody looks.
#pragma once

#include <atomic>
#include <cstdint>

#include "server/metrics/running_histogram.h"
#include "server/pipeline/frame_result.h"

namespace kinevox::metrics {

// Of the subscribers of one kind of stream.
struct StreamFigures {
    RunningHistogram age;  // of a message when it is handed to gRPC, since the daemon had it ready
    std::atomic<std::uint64_t> sent{0}, missed{0};

    void took(double age_s, std::uint64_t missed_before) {
        age.add(age_s);
        sent.fetch_add(1, std::memory_order_relaxed);
        missed.fetch_add(missed_before, std::memory_order_relaxed);
    }
};

// Any thread; since the daemon's start.
struct CaptureFigures {
    RunningHistogram segmentation, tracking, hull, colouring, pose, total;
    StreamFigures volumes, poses, pictures;

    void observe(const StageTimes& times) {
        segmentation.add(times.segmentation_ms / 1e3);
        tracking.add(times.tracking_ms / 1e3);
        hull.add(times.hull_ms / 1e3);
        colouring.add(times.colouring_ms / 1e3);
        pose.add(times.pose_ms / 1e3);
        total.add(times.total_ms / 1e3);
    }
};

}  // namespace kinevox::metrics
