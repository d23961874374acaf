// Cancellation and progress of a job that takes minutes.
#pragma once

#include <atomic>
#include <functional>

namespace kinevox {

struct JobControl {
    const std::atomic<bool>& stop;  // once true, the job ends with Cancelled
    // Called often on the job's thread with the progress, 0 to 1, increasing.
    std::function<void(double)> progress = {};

    void report(double fraction) const {
        if (progress) progress(fraction);
    }
    // For a step of the job: its progress 0 to 1 is `from` to `to` here. Must not outlive this.
    JobControl subrange(double from, double to) const {
        return {stop, [this, from, to](double fraction) { report(from + fraction * (to - from)); }};
    }
};

}  // namespace kinevox
