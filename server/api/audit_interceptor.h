// Tells the audit log of every operating call, whichever service it is of.
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
