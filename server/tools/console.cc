#include "server/tools/console.h"

#include <fmt/format.h>

#include <atomic>
#include <csignal>
#include <ctime>
#include <memory>
#include <utility>

#include "common/progress_line.h"

namespace kinevox {
namespace {

struct Console {
    explicit Console(bool quiet) : line(quiet) {}
    ProgressLine line;
    std::atomic<bool> interrupted = false;
    Interrupt interrupt{[this] { interrupted = true; }};  // last: its thread ends first
};

}  // namespace

Interrupt::Interrupt(std::function<void()> on_interrupt) {
    sigset_t signals;
    sigemptyset(&signals);
    sigaddset(&signals, SIGINT);
    sigaddset(&signals, SIGTERM);
    pthread_sigmask(SIG_BLOCK, &signals, nullptr);
    thread_ = std::jthread([signals, call = std::move(on_interrupt)](const std::stop_token& stop) {
        const timespec tenth_s{0, 100'000'000};
        while (!stop.stop_requested())
            if (sigtimedwait(&signals, nullptr, &tenth_s) > 0) {
                call();
                return;
            }
    });
}

SolveProgress console_progress(bool quiet) {
    return [console = std::make_shared<Console>(quiet)](double fraction, const std::string& what) {
        if (console->interrupted) {
            console->line.clear();
            return false;
        }
        if (fraction >= 1)
            console->line.clear();
        else if (console->line.due())
            console->line.draw(fmt::format("{:3.0f} %  {}", 100 * fraction, what));
        return true;
    };
}

}  // namespace kinevox
