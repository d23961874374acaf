// Credentials of the server's port: TLS or none, with the guard before each call.
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

// Unencrypted without an identity. The guard, which may be null, admits each call before its service sees it,
// and outlives the server.
std::shared_ptr<grpc::ServerCredentials> guarded_credentials(const std::optional<ServerIdentity>& identity,
                                                             Guard* guard);

}  // namespace kinevox
