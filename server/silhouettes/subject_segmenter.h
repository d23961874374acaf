// One camera's subject from its images alone, without tracking.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "kernels/segmentation.h"

namespace kinevox {

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
