// The channel to a daemon, and its errors in words.
#pragma once

#include <absl/status/status.h>
#include <grpcpp/grpcpp.h>

#include <memory>

#include "client/lib/client.h"

namespace kinevox::client {

// Connects when it is first used, and reconnects automatically.
std::shared_ptr<grpc::Channel> connect(const ClientOptions& options);

// Adds what goes with every call: the token.
void prepare_context(grpc::ClientContext& context, const ClientOptions& options);

// The status of a call that this client did not cancel itself; connection errors name the address, and TLS
// where the two sides do not match in it.
absl::Status to_absl(const grpc::Status& status, const ClientOptions& options);

}  // namespace kinevox::client
