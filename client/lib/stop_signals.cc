#include "client/lib/stop_signals.h"

#include <unistd.h>

#include <csignal>
#include <thread>

namespace kinevox::client {

std::stop_token stop_on_signals() {
    static const std::stop_token token = [] {
        sigset_t signals;
        sigemptyset(&signals);
        sigaddset(&signals, SIGINT);
        sigaddset(&signals, SIGTERM);
        pthread_sigmask(SIG_BLOCK, &signals, nullptr);
        std::stop_source source;
        std::thread([signals, source]() mutable {
            int signal = 0;
            sigwait(&signals, &signal);
            source.request_stop();
            sigwait(&signals, &signal);  // a second signal ends the program at once
            _exit(1);
        }).detach();
        return source.get_token();
    }();
    return token;
}

}  // namespace kinevox::client
