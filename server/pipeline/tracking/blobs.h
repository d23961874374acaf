// The separate pieces of a silhouette, as candidates for the tracked subject.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/segmentation.h"
#include "kernels/types.h"

namespace kinevox {

// Pieces of foreground that lie within about 1/60 of the picture's height of each other (a belt or a sleeve
// of the background's colour does not cut a person in two).
//
// Its centre of gravity is meant to be the projection of the body's. A silhouette has no depth: with equal
// weights the thin legs would count as much as the thick trunk and pull the centre down (by 40 to 130 mm,
// tests/accuracy/ tracking.py). So each pixel weighs with the body's thickness behind it, for which its
// distance to the silhouette's outline stands: summed across a limb of round section that grows as the
// section's area.
struct Blob {
    std::int64_t sharp_pixels = 0;
    double weight = 0;                      // sum of its sharp pixels' weights
    double centroid_x = 0, centroid_y = 0;  // px, centre of gravity of its sharp pixels
    kernels::Rect bounds;                   // px, smallest box around its loose pixels
    bool at_border = false;                 // its box touches the picture's border: part of it may be unseen
};

// Blobs with at least `min_sharp_pixels`, the largest first, at most `most`.
std::vector<Blob> find_blobs(const kernels::Silhouettes& silhouettes, std::int64_t min_sharp_pixels,
                             std::size_t most);

// Several blobs as one. Not empty.
Blob merged(const std::vector<Blob>& blobs);

}  // namespace kinevox
