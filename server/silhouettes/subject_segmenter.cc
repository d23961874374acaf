#include "server/silhouettes/subject_segmenter.h"

#include "server/silhouettes/main_subject.h"

namespace kinevox {

SubjectSegmenter::SubjectSegmenter(int width, int height, int channels,
                                   std::span<const kernels::ImageView> background,
                                   const kernels::SegmentationOptions& options)
    : width_(width),
      height_(height),
      segmenter_(kernels::make_segmenter(kernels::Device::kCpu, width, height, channels, options)) {
    segmenter_->learn(background);
}

std::vector<std::uint8_t> SubjectSegmenter::segment(const kernels::ImageView& image) {
    segmenter_->segment(image, {}, silhouettes_);
    return main_subject(silhouettes_.sharp, width_, height_);
}

}  // namespace kinevox
