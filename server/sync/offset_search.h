// The steps of solve_offsets().
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "server/sync/evidence.h"
#include "server/sync/offsets.h"

namespace kinevox::sync {

// Whole frames; the first camera's offset is 0. The largest sum of evidence from several starts, moving one
// camera at a time.
std::vector<int> whole_offsets(const std::vector<PairEvidence>& pairs, std::size_t cameras, int max_lag);

// A group of cameras against all others: group[camera].
using Group = std::vector<bool>;
// All bipartitions of up to eight cameras; for more cameras, each against the rest and those that cut one
// link of the strongest tree. A group has at most half of the cameras.
std::vector<Group> bipartitions(const std::vector<PairEvidence>& pairs, std::size_t cameras,
                                const std::vector<int>& offsets);

// Evidence between the group and the others as the group is shifted from -max_shift to max_shift frames.
struct GroupCurve {
    std::vector<double> evidence;  // [shift + max_shift]
    std::vector<int> overlap;      // images, of all pairs
};
GroupCurve group_curve(const std::vector<PairEvidence>& pairs, const Group& group,
                       const std::vector<int>& offsets, int max_shift);

// Sub-frame offsets from the pairs' peaks near the whole offsets: least squares with down-weighted outliers.
struct FineOffsets {
    std::vector<double> frames, std_frames;  // their mean is 0
    std::vector<PairFit> pairs;
};
FineOffsets fine_offsets(const std::vector<PairEvidence>& pairs, std::size_t cameras,
                         const std::vector<int>& whole);

}  // namespace kinevox::sync
