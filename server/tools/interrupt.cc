#include "server/tools/interrupt.h"

#include <csignal>
#include <ctime>
#include <utility>

namespace kinevox {

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

}  // namespace kinevox
