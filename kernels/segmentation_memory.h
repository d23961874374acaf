// A segmenter that can go back to what it was when it had learned the background: for recordings in which
// somebody jumps about.
#pragma once

#include <memory>

#include "kernels/segmentation.h"

namespace kinevox::kernels {

class RewindableSegmenter : public Segmenter {
  public:
    // To be called before learn(): keeps what is learned beside what the frames make of it, which takes the
    // model's memory twice.
    virtual void keep_learned() = 0;
    // Forgets all that frames have taught it since learn(): the next one is segmented as the first one was.
    // Throws std::logic_error where nothing was learned and kept.
    virtual void forget_frames() = 0;
};

// As make_segmenter(), on either device; keep_learned() is called already.
std::unique_ptr<RewindableSegmenter> make_rewindable_segmenter(Device device, int width, int height,
                                                               int channels,
                                                               const SegmentationOptions& options = {});

}  // namespace kinevox::kernels
