#include "server/daemon/service_clock.h"

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

void tell(const std::string& words) {
    sd_notify(0, words.c_str());
}

std::string in_words(const Runner& runner) {
    const Runner::State state = runner.state();
    const std::string more = state.message.empty() ? "" : ": " + state.message;
    switch (state.state) {
        case RunState::kStopped:
            return "stopped" + more;
        case RunState::kStarting:
            return "starting" + more;
        case RunState::kLearning:
            return "learning the background" + more;
        case RunState::kEnded:
            return "ended" + more;
        case RunState::kFailed:
            return "failed" + more;
        case RunState::kRunning:
            break;
    }
    const RunFigures figures = runner.figures();
    return fmt::format("capturing, {:.1f} frame sets a second, {} lost", figures.results_per_second,
                       figures.lost);
}

}  // namespace

ServiceClock::ServiceClock(boost::asio::io_context& io, const Runner& runner, const Gpu* gpu)
    : runner_(runner), gpu_(gpu), timer_(io), watchdog_(watchdog_interval()) {}

void ServiceClock::ready() {
    tell("READY=1");
    look();
    wait();
}

void ServiceClock::wait() {
    timer_.expires_after(watchdog_.period());
    timer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        look();
        wait();
    });
}

void ServiceClock::look() {
    switch (watchdog_.look(runner_.max_in_hand())) {
        case Watchdog::Word::kNone:
            break;
        case Watchdog::Word::kAlive:
            tell("WATCHDOG=1");
            break;
        case Watchdog::Word::kHung: {
            const LogFields fields{{"KINEVOX_EVENT", "hang"}};
            spdlog::critical(
                "the pipeline hangs: it has had a frame set in hand for {:.1f} s; the service manager is "
                "asked "
                "to start the daemon anew",
                std::chrono::duration<double>(watchdog_.max_in_hand()).count());
            tell("WATCHDOG=trigger");
            break;
        }
    }
    std::string words = in_words(runner_);
    if (gpu_ && !gpu_->usable()) words += "; the GPU has failed, the CPU computes";
    if (words != told_) {
        tell("STATUS=" + words);
        told_ = std::move(words);
    }
}

void ServiceClock::stop() {
    timer_.cancel();
    tell("STOPPING=1");
}

}  // namespace kinevox
