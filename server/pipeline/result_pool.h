// Results whose memory is used again once their last holder lets go: a frame set's silhouettes are megabytes.
#pragma once

#include <memory>

#include "server/pipeline/frame_result.h"

namespace kinevox {

// Thread safe. Results may outlive the pool. Keeps a few idle results, frees the rest.
class ResultPool {
  public:
    ResultPool();

    // Everything as in a new FrameResult, but `silhouettes` still has its buffers, with old contents.
    std::shared_ptr<FrameResult> take();

  private:
    struct Shelf;
    std::shared_ptr<Shelf> shelf_;
};

}  // namespace kinevox
