// A segmenter that can return to its state after learn(), for replays with seeks.
#pragma once

#include <memory>

#include "kernels/segmentation.h"

namespace kinevox::kernels {

class RewindableSegmenter : public Segmenter {
  public:
    // Call before learn(): keeps a copy of the learned model, which doubles its memory.
    virtual void keep_learned() = 0;
    // Returns to the state after learn(): the next frame is segmented like the first. Throws std::logic_error
    // if no learned model was kept.
    virtual void forget_frames() = 0;
};

// As make_segmenter(), on either device, with keep_learned() already called.
std::unique_ptr<RewindableSegmenter> make_rewindable_segmenter(Device device, int width, int height,
                                                               int channels,
                                                               const SegmentationOptions& options = {},
                                                               std::shared_ptr<DeviceContext> context = {});

}  // namespace kinevox::kernels
