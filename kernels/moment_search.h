// Exhaustive nearest-neighbour search over poses seen from all directions: the inner loop of the pose
// database.
//
// A view is a pose seen from one direction; its description is a code of kCodeBytes numbers of 0..127. A slab
// holds every pose from kViewBins relative headings (the body's heading minus the direction to the camera),
// 10 deg apart. Headings of the body go in half of these steps and cameras stand anywhere, so a heading's
// description lies between two views: with V = (1 - w) a + w b the squared distance to a query q is
//   (1 - w) |q - a|^2 + w |q - b|^2 - w (1 - w) |a - b|^2,
// which costs no more than looking at both.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

namespace kinevox::kernels {

inline constexpr int kCodeBytes = 32;
inline constexpr int kViewBins = 36;             // relative headings of a view, from 0 in equal steps
inline constexpr int kHeadings = 2 * kViewBins;  // headings that are scored
inline constexpr int kCodeMax = 127;

struct MomentSlab {
    int poses = 0;
    std::vector<std::uint8_t>
        blocks;  // [group of 8 views][code byte / 4][view][4]; the last group padded by zeros
    std::vector<float> neighbours;  // per view its squared distance to the next one around, in code units

    // `codes`: poses * kViewBins codes, views of a pose one after the other.
    static MomentSlab make(std::span<const std::uint8_t> codes);
};

// What one camera sees.
struct MomentQuery {
    const MomentSlab* slab = nullptr;
    const std::uint8_t* code = nullptr;  // kCodeBytes
    double first_bin = 0;                // where the body's heading 0 falls among the bins, any real number
};

// The mean over the cameras of the squared distance, for every pose and heading: `scores` has slab.poses *
// kHeadings entries, heading n is n * 360 / kHeadings deg. All slabs have the same number of poses.
void score_headings(std::span<const MomentQuery> queries, std::span<float> scores);

// |query - (weight_a a + weight_b b)|^2 over `values` numbers: one record against a query by all its moments.
float blended_distance(const float* query, const std::int16_t* a, const std::int16_t* b, float weight_a,
                       float weight_b, int values);

}  // namespace kinevox::kernels
