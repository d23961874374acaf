// The connected blobs of a silhouette, as candidates for the tracked subject.
#pragma once

#include <cstdint>
#include <vector>

#include "kernels/segmentation.h"
#include "kernels/types.h"

namespace kinevox {

// Components of foreground within about 1/60 of the image height of each other (a belt or a sleeve of the
// background's colour does not split a person).
//
// Its centre of gravity approximates the projection of the body's. A silhouette has no depth: with equal
// weights the thin legs would count as much as the thick trunk and lower the centre (by 40 to 130 mm,
// tests/accuracy/tracking.py). So each pixel is weighted by its distance to the contour, a measure of the
// body's thickness: summed across a round limb, it grows with the area of the section.
struct Blob {
    std::int64_t sharp_pixels = 0;
    double weight = 0;                      // sum of its sharp pixels' weights
    double centroid_x = 0, centroid_y = 0;  // px, centre of gravity of its sharp pixels
    kernels::Rect bounds;                   // px, smallest box around its loose pixels
    bool at_border = false;                 // its box touches the image border: the subject may be truncated
};

// Blobs with at least `min_sharp_pixels`, the largest first, at most `max_count`.
std::vector<Blob> find_blobs(const kernels::Silhouettes& silhouettes, std::int64_t min_sharp_pixels,
                             std::size_t max_count);

// Several blobs as one; `blobs` is not empty.
Blob merged(const std::vector<Blob>& blobs);

}  // namespace kinevox
