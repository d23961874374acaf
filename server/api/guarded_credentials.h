// What the server's port is opened with: TLS or none, and the guard before every call.
#pragma once

#include <memory>
#include <optional>
#include <string>

namespace grpc {
class ServerCredentials;
}

namespace kinevox {

class Guard;

// PEM.
struct ServerIdentity {
    std::string certificate, key;
    std::string client_ca;  // empty: clients need no certificate
};

// Without an identity nothing is encrypted. The guard, which may be null, is asked before any part of a call
// is handed to its service, and outlives the server.
std::shared_ptr<grpc::ServerCredentials> guarded_credentials(const std::optional<ServerIdentity>& identity,
                                                             Guard* guard);

}  // namespace kinevox
