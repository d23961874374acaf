#include <algorithm>

#include "kernels/cpu/upload_work.h"
#include "kernels/cuda/segmentation_upload.h"

namespace kinevox::kernels::cuda {

using kde::kCellPixels;

void ExpectedUpload::pack(const std::uint8_t* mask, int width, int height) {
    cells_per_row_ = (width + kCellPixels - 1) / kCellPixels;
    words_.resize(static_cast<std::size_t>(height) * cells_per_row_);
    cpu::pack_mask(mask, width, height, words_.data());
    box_ = {height, 0, cells_per_row_, 0};
    for (int y = 0; y < height; ++y) {
        const Word* const row = words_.data() + static_cast<std::size_t>(y) * cells_per_row_;
        for (int k = 0; k < cells_per_row_; ++k) {
            if (row[k] == 0) continue;
            box_.y0 = std::min(box_.y0, y), box_.y1 = y + 1;
            box_.k0 = std::min(box_.k0, k), box_.k1 = std::max(box_.k1, k + 1);
        }
    }
    if (box_.empty()) box_ = {};
}

void ExpectedUpload::copy_to(Word* out) const {
    for (int y = box_.y0; y < box_.y1; ++y, out += box_.columns())
        std::copy_n(words_.data() + static_cast<std::size_t>(y) * cells_per_row_ + box_.k0, box_.columns(),
                    out);
}

FrameSet FrameUpload::upload(const Stream& stream, std::span<const CameraUpload> cameras) {
    // Once for any silhouette: memory that grew with the subject would stop the device now and then.
    memory_.clear();
    memory_.reserve<SegmentData>(cameras.size());
    for (const CameraUpload& camera : cameras) {
        memory_.reserve<float>(camera.log_foreground.size());
        memory_.reserve<Word>(camera.data->cell(camera.data->height, 0));
    }
    memory_.place();

    memory_.clear();
    const std::size_t at = memory_.reserve<SegmentData>(cameras.size());
    std::vector<std::size_t> colours, expected;
    for (const CameraUpload& camera : cameras) {
        const CellRange& box = camera.expected->box();
        colours.push_back(memory_.reserve<float>(camera.log_foreground.size()));
        expected.push_back(memory_.reserve<Word>(static_cast<std::size_t>(box.rows()) * box.columns()));
    }
    memory_.place();
    SegmentData* const host = memory_.host<SegmentData>(at);
    for (std::size_t n = 0; n < cameras.size(); ++n) {
        const CameraUpload& camera = cameras[n];
        host[n] = *camera.data;
        host[n].look = camera.look;
        host[n].log_foreground = memory_.device<float>(colours[n]);
        std::copy(camera.log_foreground.begin(), camera.log_foreground.end(),
                  memory_.host<float>(colours[n]));
        host[n].expected = {};
        if (camera.expected->empty()) continue;
        host[n].expected = {memory_.device<Word>(expected[n]), camera.expected->box()};
        camera.expected->copy_to(memory_.host<Word>(expected[n]));
    }
    memory_.upload(stream);
    return {{host, cameras.size()}, memory_.device<SegmentData>(at), host[0].channels};
}

}  // namespace kinevox::kernels::cuda
