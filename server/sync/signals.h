// Signals of one movement that are comparable between two cameras.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "server/sync/camera_motion.h"

namespace kinevox::sync {

// One value per image; NaN where there is none.
using Signal = std::vector<double>;

// Of the cameras `first` and `second`, in that order in each array.
struct PairSignals {
    std::size_t first = 0, second = 0;
    // Equal at the same instant, px: the planes through both camera centres that touch the subject.
    std::vector<std::array<Signal, 2>> equal_px;
    // Correlated, in any unit.
    std::vector<std::array<Signal, 2>> alike;
};

// Names as in tables and plots.
struct MovementSignals {
    Signal top;       // vertical speed of the silhouette's top, in its heights per second
    Signal centroid;  // of its centroid
    Signal change;    // logarithm of the changed fraction from one image to the next
    // The same before high-pass filtering, for plots: fraction of the silhouette per second.
    Signal changed_fraction;
    double hardly_moves = 0;  // median fraction of the silhouette that differs from the previous image
};

MovementSignals movement_signals(const CameraMotion& motion, double fps);

struct SignalOptions {
    bool use_extrinsics = true;  // false: only signals that need no calibration
};

// All pairs of cameras. Pairs with uninformative extrinsics (equal positions, or one looks along the
// baseline) have no equal_px.
std::vector<PairSignals> pair_signals(const std::vector<CameraMotion>& cameras, double fps,
                                      const SignalOptions& options = {});

// Gaussian; NaN stays NaN.
Signal smoothed(const Signal& signal, double std_samples);

}  // namespace kinevox::sync
