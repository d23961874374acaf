#include "server/pipeline/gpu.h"

#include <fmt/chrono.h>

#include <chrono>
#include <ctime>
#include <utility>

namespace kinevox {

Gpu::Gpu(std::unique_ptr<const kernels::StageFactory> stages)
    : stages_(std::move(stages)), name_(stages_->name()) {
    if (const std::string problem = stages_->problem(); !problem.empty()) report_failure(problem);
}

bool Gpu::usable() const {
    const std::scoped_lock lock(mutex_);
    return failures_ == 0;
}

void Gpu::report_failure(const std::string& what) {
    const std::scoped_lock lock(mutex_);
    if (++failures_ > 1) return;
    message_ = fmt::format(
        "the GPU {}{} failed: {}; the CPU computes since {:%Y-%m-%d %H:%M:%S} UTC, more slowly; check "
        "the GPU (kinevox devices, kinevox doctor), then restart the daemon",
        device(), name_.empty() ? "" : " (" + name_ + ")", what, fmt::gmtime(std::time(nullptr)));
    pending_message_ = message_;
}

Gpu::State Gpu::state() const {
    State state;
    {
        const std::scoped_lock lock(mutex_);
        state = {device(), name_, failures_ == 0, failures_, message_, {}};
    }
    if (state.usable) state.memory = stages_->memory();
    return state;
}

std::string Gpu::message() const {
    const std::scoped_lock lock(mutex_);
    return message_;
}

std::string Gpu::take_message() {
    const std::scoped_lock lock(mutex_);
    return std::exchange(pending_message_, {});
}

}  // namespace kinevox
