#include "server/daemon/service_timer.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>
#include <systemd/sd-daemon.h>

#include "common/log_fields.h"
#include "server/pipeline/gpu.h"

namespace kinevox {
namespace {

std::chrono::nanoseconds watchdog_interval() {
    std::uint64_t microseconds = 0;
    return sd_watchdog_enabled(0, &microseconds) > 0 ? std::chrono::microseconds(microseconds)
                                                     : std::chrono::microseconds(0);
}

void notify(const std::string& message) {
    sd_notify(0, message.c_str());
}

std::string describe_status(const Runner& runner) {
    const Runner::State state = runner.state();
    const std::string detail = state.message.empty() ? "" : ": " + state.message;
    switch (state.state) {
        case RunState::kStopped:
            return "stopped" + detail;
        case RunState::kStarting:
            return "starting" + detail;
        case RunState::kLearning:
            return "learning the background" + detail;
        case RunState::kEnded:
            return "source ended" + detail;
        case RunState::kFailed:
            return "failed" + detail;
        case RunState::kRunning:
            break;
    }
    const RunSnapshot snapshot = runner.snapshot();
    return fmt::format("capturing, {:.1f} frame sets per second, {} lost", snapshot.result_rate_hz,
                       snapshot.lost_count);
}

}  // namespace

ServiceTimer::ServiceTimer(boost::asio::io_context& io, const Runner& runner, const Gpu* gpu)
    : runner_(runner), gpu_(gpu), timer_(io), watchdog_(watchdog_interval()) {}

void ServiceTimer::ready() {
    notify("READY=1");
    check();
    wait();
}

void ServiceTimer::wait() {
    timer_.expires_after(watchdog_.period());
    timer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        check();
        wait();
    });
}

void ServiceTimer::check() {
    switch (watchdog_.check(runner_.max_busy_time())) {
        case Watchdog::Signal::kNone:
            break;
        case Watchdog::Signal::kAlive:
            notify("WATCHDOG=1");
            break;
        case Watchdog::Signal::kHung: {
            const LogFields fields{{"KINEVOX_EVENT", "pipeline_hang"}};
            spdlog::critical(
                "the pipeline hangs: busy with one frame set for {:.1f} s; requesting a restart by the "
                "service manager",
                std::chrono::duration<double>(watchdog_.max_busy_time()).count());
            notify("WATCHDOG=trigger");
            break;
        }
    }
    std::string status = describe_status(runner_);
    if (gpu_ && !gpu_->usable()) status += "; the GPU " + gpu_->device() + " failed, the CPU computes";
    if (status != status_) {
        notify("STATUS=" + status);
        status_ = std::move(status);
    }
}

void ServiceTimer::stop() {
    timer_.cancel();
    notify("STOPPING=1");
}

}  // namespace kinevox
