// What two cameras see of one movement, as signals that can be laid over each other.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "server/sync/camera_motion.h"

namespace kinevox::sync {

// One value a picture; NaN where there is none.
using Signal = std::vector<double>;

// Of the cameras `first` and `second`, in that order in each array.
struct PairSignals {
    std::size_t first = 0, second = 0;
    // Have the same value at the same instant, px: where the planes that contain both cameras' centres touch
    // the subject.
    std::vector<std::array<Signal, 2>> equal_px;
    // Rise and fall together, in whatever unit.
    std::vector<std::array<Signal, 2>> alike;
};

// What a camera's signals are called in tables and plots.
struct MovementSignals {
    Signal top;       // how fast the silhouette's top rises, in parts of its height a second
    Signal centroid;  // its centroid likewise
    Signal change;    // logarithm of how much of it changes from one picture to the next
    // The same before slow parts were taken off, for plots: parts of the silhouette a second.
    Signal changed_part;
    double hardly_moves = 0;  // median part of the silhouette that differs from the picture before
};

MovementSignals movement_signals(const CameraMotion& motion, double fps);

struct SignalOptions {
    bool use_places = true;  // false: nothing but what needs no calibration
};

// All pairs of cameras. Pairs whose places tell nothing (the same place, or one looks along the line to the
// other) have no equal_px.
std::vector<PairSignals> pair_signals(const std::vector<CameraMotion>& cameras, double fps,
                                      const SignalOptions& options = {});

// Gaussian, over what there is around; NaN stays NaN.
Signal smoothed(const Signal& signal, double deviation_samples);

}  // namespace kinevox::sync
