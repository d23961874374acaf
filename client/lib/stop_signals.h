// How a client program that runs until it is stopped hears of it.
#pragma once

#include <stop_token>

namespace kinevox::client {

// A token that SIGINT and SIGTERM stop; a second signal ends the program at once. The first call blocks these
// signals and starts the thread that waits for them: make it before gRPC starts threads, which would get them
// else.
std::stop_token stop_on_signals();

}  // namespace kinevox::client
