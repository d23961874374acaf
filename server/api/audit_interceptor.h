// Writes each operating call, of any service, to the audit log.
#pragma once

#include <memory>

namespace grpc::experimental {
class ServerInterceptorFactoryInterface;
}

namespace kinevox {

class Guard;

// `guard` has an audit log and outlives the server.
std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> audit_interceptors(const Guard& guard);

}  // namespace kinevox
