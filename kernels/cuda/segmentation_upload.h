// What a frame set needs beside its images, on its way to the device: one piece of memory for all cameras,
// copied at once.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "kernels/cuda/segmentation_steps.h"

namespace kinevox::kernels::cuda {

// The expected silhouette of a camera, a bit per pixel.
class ExpectedUpload {
  public:
    // `mask`: width * height bytes.
    void pack(const std::uint8_t* mask, int width, int height);
    void clear() { words_.clear(), box_ = {}; }
    bool empty() const { return words_.empty(); }
    const CellRange& box() const { return box_; }
    // The words of the cells in box(), row by row.
    void copy_to(Word* out) const;

  private:
    std::vector<Word> words_;  // of the whole image
    int cells_per_row_ = 0;
    CellRange box_;  // around the cells that are not 0
};

struct CameraUpload {
    const SegmentData* data = nullptr;
    bool look = false;  // SegmentData::look
    std::span<const float> log_foreground;
    const ExpectedUpload* expected = nullptr;
};

class FrameUpload {
  public:
    // Queues the copy; `stream` must have been waited for since the last call.
    FrameSet upload(const Stream& stream, std::span<const CameraUpload> cameras);

  private:
    PackedUpload memory_;
};

}  // namespace kinevox::kernels::cuda
