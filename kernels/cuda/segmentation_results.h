// The results of a frame set on their way to the host: one piece of memory for all cameras, copied at once.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "kernels/cuda/segmentation_steps.h"
#include "kernels/segmentation.h"

namespace kinevox::kernels::cuda {

// Of one camera, in pinned memory; valid until its frame set's memory is used again.
class FrameResults {
  public:
    const CameraResult& result() const { return *result_; }
    const int* counts() const { return counts_; }  // per colour bin

    // Fills `out`, whose memory is reused: it is 0 outside what its own rectangles state.
    void unpack(const SegmentData& camera, const Rect& searched, Silhouettes& out) const;

  private:
    friend class ResultMemory;
    const int* counts_ = nullptr;
    const CameraResult* result_ = nullptr;
    const Word *sharp_ = nullptr, *loose_ = nullptr;
    const std::uint8_t* probability_ = nullptr;
};

class ResultMemory {
  public:
    // Room for the cameras' results; sets where the device leaves them.
    std::vector<FrameResults> place(std::span<SegmentData* const> cameras);

    void queue_clear(const Stream& stream) const;
    void queue_download(const Stream& stream) const;

  private:
    DeviceBuffer<std::uint8_t> device_;
    PinnedBuffer<std::uint8_t> host_;
};

}  // namespace kinevox::kernels::cuda
