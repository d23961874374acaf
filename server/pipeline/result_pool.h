// Reuses the memory of results after their last release: the silhouettes of a frame set are megabytes.
#pragma once

#include <memory>

#include "server/pipeline/frame_result.h"

namespace kinevox {

// Thread safe. Results may outlive the pool. Keeps a few idle results, frees the rest.
class ResultPool {
  public:
    ResultPool();

    // As a new FrameResult, except that `silhouettes` keeps its buffers, with old contents.
    std::shared_ptr<FrameResult> take();

  private:
    struct Shelf;
    std::shared_ptr<Shelf> shelf_;
};

}  // namespace kinevox
