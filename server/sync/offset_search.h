// The steps of solve_offsets().
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "server/sync/evidence.h"
#include "server/sync/offsets.h"

namespace kinevox::sync {

// Whole frames; the first camera's offset is 0. The largest sum of evidence that is found from several
// beginnings by moving one camera after the other.
std::vector<int> whole_offsets(const std::vector<PairEvidence>& pairs, std::size_t cameras, int max_lag);

// A group of cameras against all others. member[camera]
using Group = std::vector<bool>;
// All ways to part up to eight cameras in two; of more cameras, each against the rest and what remains when a
// link of the strongest tree is cut. A group holds at most half of the cameras.
std::vector<Group> ways_to_part(const std::vector<PairEvidence>& pairs, std::size_t cameras,
                                const std::vector<int>& offsets);

// What ties the group to the others as all of it is shifted, from -most to most frames.
struct GroupCurve {
    std::vector<double> evidence;  // [shift + most]
    std::vector<int> overlap;      // pictures, of all pairs
};
GroupCurve group_curve(const std::vector<PairEvidence>& pairs, const Group& group,
                       const std::vector<int>& offsets, int most);

// Parts of a frame, from the pairs' peaks near the whole offsets: least squares, pairs that disagree count
// less.
struct FineOffsets {
    std::vector<double> frames, deviation_frames;  // their mean is 0
    std::vector<PairFit> pairs;
};
FineOffsets fine_offsets(const std::vector<PairEvidence>& pairs, std::size_t cameras,
                         const std::vector<int>& whole);

}  // namespace kinevox::sync
