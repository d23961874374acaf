// SIGINT and SIGTERM as a stop token, for client programs that run until they are stopped.
#pragma once

#include <stop_token>

namespace kinevox::client {

// A token that SIGINT and SIGTERM stop; a second signal ends the program at once. The first call blocks these
// signals and starts the thread that waits for them: call it before gRPC starts threads, which would receive
// them otherwise.
std::stop_token stop_on_signals();

}  // namespace kinevox::client
