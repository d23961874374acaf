// Silhouettes of a moving person: one camera's subject from its images alone, without tracking, and sets of
// several cameras.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "kernels/segmentation.h"

namespace kinevox {

// Of one camera in one frame set: height * width bytes, 0 or 255; empty if there is none.
struct SilhouetteMask {
    std::vector<std::uint8_t> mask;
    bool truncated = false;  // by the image border

    bool empty() const { return mask.empty(); }
};

// frame_sets[frame set][camera].
struct SilhouetteSet {
    std::vector<std::vector<SilhouetteMask>> frame_sets;
};

// Selects the person among the foreground components of a mask: the largest component of `mask` (rows of
// `width`, no padding; non-zero is foreground) and the components next to it, which may be parts of the same
// person separated by an occlusion. The result is 0 or 255, of the mask's size; empty if the largest
// component is too small to be a person.
std::vector<std::uint8_t> main_subject(std::span<const std::uint8_t> mask, int width, int height);

// Not thread safe; one per camera.
class SubjectSegmenter {
  public:
    // `background`: one or more images of the empty scene, of the size of the images to segment.
    SubjectSegmenter(int width, int height, int channels, std::span<const kernels::ImageView> background,
                     const kernels::SegmentationOptions& options);

    // See main_subject(). Images in the order of the video: the background model adapts to them.
    std::vector<std::uint8_t> segment(const kernels::ImageView& image);

  private:
    int width_, height_;
    std::unique_ptr<kernels::Segmenter> segmenter_;
    kernels::Silhouettes silhouettes_;
};

}  // namespace kinevox
