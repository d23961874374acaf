// The guard before each call: TLS and authorisation of the server's port, and the audit log of operating
// calls.
#pragma once

#include <memory>
#include <optional>
#include <string>

namespace grpc {
class ServerCredentials;
namespace experimental {
class ServerInterceptorFactoryInterface;
}
}  // namespace grpc

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

// Writes each operating call, of any service, to the audit log. `guard` has an audit log and outlives the
// server.
std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> audit_interceptors(const Guard& guard);

}  // namespace kinevox
