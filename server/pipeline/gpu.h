// The GPU that a daemon's pipelines share until it fails: from then on the CPU computes for all of them, and
// the clients are notified. After a failure CUDA's context stays broken, so the GPU is not used again before
// the daemon's next start.
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
    explicit Gpu(std::unique_ptr<const kernels::StageFactory> stages);

    const kernels::StageFactory& stages() const { return *stages_; }
    std::string device() const { return kernels::name_of(stages_->device()); }  // "cuda:1"
    // "NVIDIA T4"; empty if it could not be used from the start.
    const std::string& name() const { return name_; }
    bool usable() const;

    // `what` went wrong, in one line. Only the first failure is reported.
    void report_failure(const std::string& what);

    struct State {
        std::string device, name;  // of the GPU, as above
        bool usable = true;
        std::uint64_t failures = 0;
        std::string message;  // why the CPU computes, since when and the remedy; empty while the GPU does
        kernels::DeviceMemory memory;  // zeros if the GPU is not used
    };
    State state() const;  // queries the GPU's memory
    std::string message() const;

    // The message, once; else empty.
    std::string take_message();

  private:
    const std::unique_ptr<const kernels::StageFactory> stages_;
    const std::string name_;  // known before it fails
    mutable std::mutex mutex_;
    std::uint64_t failures_ = 0;
    std::string message_, pending_message_;
};

}  // namespace kinevox
