// The GPU that a daemon's pipelines share, until it fails: from then on the CPU computes for all of them, and
// the clients are told. A process whose GPU has failed once cannot count on it any more (CUDA's context stays
// broken), so that it is not tried again before the daemon's next start.
#pragma once

#include <cstdint>
#include <memory>
#include <mutex>
#include <string>

#include "kernels/stages.h"

namespace kinevox {

// Thread safe.
class Gpu {
  public:
    // One that cannot be used has failed already.
    explicit Gpu(std::unique_ptr<const kernels::StageMaker> stages);

    const kernels::StageMaker& stages() const { return *stages_; }
    bool usable() const;

    // `what` went wrong, in one line. Only the first one is told.
    void fail(const std::string& what);

    struct State {
        bool usable = true;
        std::uint64_t failures = 0;
        std::string message;  // why the CPU computes, since when and what to do; empty while the GPU does
        kernels::DeviceMemory memory;  // zeros where the GPU is not used
    };
    State state() const;  // asks the GPU for its memory
    std::string message() const;

    // The message, once; else empty.
    std::string take_news();

  private:
    const std::unique_ptr<const kernels::StageMaker> stages_;
    const std::string name_;  // known before it fails
    mutable std::mutex mutex_;
    std::uint64_t failures_ = 0;
    std::string message_, news_;
};

}  // namespace kinevox
