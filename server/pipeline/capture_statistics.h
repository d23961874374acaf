// What is counted for the metrics while the capture runs; everything else is queried when they are read.
#pragma once

#include <atomic>
#include <cstdint>

#include "server/pipeline/frame_result.h"
#include "server/pipeline/running_histogram.h"

namespace kinevox {

// Of the subscribers of one kind of stream.
struct StreamStatistics {
    RunningHistogram latency;  // from publication to handing the message to gRPC
    std::atomic<std::uint64_t> sent{0}, missed{0};

    void record(double latency_s, std::uint64_t missed_before) {
        latency.add(latency_s);
        sent.fetch_add(1, std::memory_order_relaxed);
        missed.fetch_add(missed_before, std::memory_order_relaxed);
    }
};

// Any thread; since the daemon's start.
struct CaptureStatistics {
    RunningHistogram segmentation, tracking, hull, colouring, pose, total;
    StreamStatistics volumes, poses, images;

    void observe(const StageTimes& times) {
        segmentation.add(times.segmentation_ms / 1e3);
        tracking.add(times.tracking_ms / 1e3);
        hull.add(times.hull_ms / 1e3);
        colouring.add(times.colouring_ms / 1e3);
        pose.add(times.pose_ms / 1e3);
        total.add(times.total_ms / 1e3);
    }
};

}  // namespace kinevox
