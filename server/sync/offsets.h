// Offsets of all cameras at which the evidence of all pairs together is largest, and whether there is but one
// such answer.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "server/sync/evidence.h"

namespace kinevox::sync {

struct OffsetOptions {
    double fps = 30;
    double max_shift_s = 30;  // between any two cameras
    // Nats that tie any group of cameras to the others: where nothing is equal, and where something is, which
    // a calibration of another place or a camera of another recording makes look equal for a while.
    double min_evidence = 25, min_evidence_equal = 50;
    // Where something is equal, a group's evidence a picture must also be such a part of that of the best
    // quarter of pairs: a camera of another recording finds a shift at which it fits a little, but never as
    // well as the others do.
    double min_part = 0.4;
    // Another shift whose evidence a picture is so near to the best one's, over so much of its overlap, makes
    // it ambiguous.
    double rival_quality = 0.88, rival_overlap = 0.4;
    double widest_s = 0.15;  // evidence must fall off within that, or within three frames
    double max_miss_px = 4;  // median, of a camera's equal signals, in the unit below
    double pixel_px = 1;     // a 640th of the picture's longer side
};

// Of two cameras, at the answer.
struct PairFit {
    std::size_t first = 0, second = 0;
    double lag_frames = 0;        // where this pair alone has its peak nearby; NaN where it has none
    double deviation_frames = 0;  // of that
    double disagrees_frames = 0;  // lag_frames less what all pairs together say
    double weight = 0;            // 0 .. 1: less where it disagrees
    double evidence = 0;
    std::optional<double> miss_px;  // of equal signals, median
};

// What ties one camera to all others, by shift from the answer.
struct ShiftCurve {
    int lowest_frames = 0;
    std::vector<double> evidence;  // nats, from there on, a frame apart
};

struct CameraFit {
    double offset_s = 0;     // the earliest camera's is 0
    double deviation_s = 0;  // standard deviation against all cameras' common time
    double evidence = 0;     // nats, of the weakest tie of any group with this camera to the others
    // Of the best other shift, against the answer's: evidence a picture. 0 where there is none to speak of,
    // 1: as good.
    double rival = 0;
    double rival_shift_s = 0;
    ShiftCurve curve;
};

struct OffsetSolution {
    std::vector<CameraFit> cameras;
    std::vector<PairFit> pairs;
};

// `names`: of the cameras, for messages. FailedPrecondition, with cameras, figures and what to do, where a
// group of cameras is not tied to the others, where it fits at several shifts, where its shift is not sharp,
// or where the places of the cameras do not fit what they see.
absl::StatusOr<OffsetSolution> solve_offsets(std::vector<PairEvidence>& pairs,
                                             std::span<const std::string> names,
                                             const OffsetOptions& options);

}  // namespace kinevox::sync
