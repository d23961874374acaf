// Offsets of all cameras that maximise the total evidence of all pairs, and whether the maximum is unique.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "server/sync/camera_motion.h"
#include "server/sync/evidence.h"
#include "server/sync/signals.h"

namespace kinevox::sync {

struct OffsetOptions {
    double fps = 30;
    double max_offset_s = 30;  // between any two cameras
    // Minimum evidence (nats) between any group of cameras and the others: without equal signals, and with
    // them, because a wrong calibration or a camera of another recording can make signals look equal for a
    // while.
    double min_evidence = 25, min_evidence_equal = 75;
    // With equal signals, a group's evidence per image must also be this fraction of that of the best quarter
    // of pairs: a camera of another recording has a weakly matching shift, but never a good one.
    double min_quality_fraction = 0.4;
    // Another shift with this fraction of the best evidence per image, over this fraction of its overlap,
    // makes the result ambiguous.
    double runner_up_quality = 0.88, runner_up_overlap = 0.4;
    double max_peak_width_s = 0.15;  // evidence must fall off within this, or within three frames
    double max_residual_px = 4;      // median over a camera's equal signals, in units of pixel_px
    double pixel_px = 1;             // a 640th of the image's longer side
};

// One pair of cameras at the solution.
struct PairFit {
    std::size_t first = 0, second = 0;
    double lag_frames = 0;       // where this pair alone has its peak nearby; NaN without a peak
    double std_frames = 0;       // of that
    double residual_frames = 0;  // lag_frames minus the lag of the joint solution
    double weight = 0;           // 0 .. 1: less for outliers
    double evidence = 0;
    std::optional<double> residual_px;  // of equal signals, median
};

// Evidence between one camera and all others, by shift from the solution.
struct ShiftCurve {
    int lowest_frames = 0;
    std::vector<double> evidence;  // nats, from there on, one frame apart
};

struct CameraFit {
    double offset_s = 0;  // the earliest camera's is 0
    double std_s = 0;     // standard deviation against all cameras' common time
    double evidence = 0;  // nats, of the weakest link of any group with this camera to the others
    // Evidence per image of the best other shift as a fraction of the solution's. 0: none, 1: equally good.
    double runner_up = 0;
    double runner_up_offset_s = 0;
    ShiftCurve curve;
};

struct OffsetSolution {
    std::vector<CameraFit> cameras;
    std::vector<PairFit> pairs;
};

// `names`: of the cameras, for messages. FailedPrecondition, with cameras, numbers and remedy, if a group of
// cameras has too little evidence, several matching shifts or a blurred peak, or if the extrinsics are
// inconsistent with the silhouettes.
absl::StatusOr<OffsetSolution> solve_offsets(std::vector<PairEvidence>& pairs,
                                             std::span<const std::string> names,
                                             const OffsetOptions& options);

struct AlignOptions {
    double max_offset_s = 30;
    bool use_extrinsics = true;
};

struct Alignment {
    OffsetSolution solution;
    bool used_extrinsics = false;            // extrinsics were used
    std::vector<MovementSignals> movements;  // per camera
};

// From each camera's motion to the cameras' offsets. FailedPrecondition as solve_offsets(), and if a camera
// never sees a person.
absl::StatusOr<Alignment> align(const std::vector<CameraMotion>& cameras, double fps,
                                const AlignOptions& options);

}  // namespace kinevox::sync
