// gRPC's calls: their credentials, and unary ones on a thread of the daemon.
#pragma once

#include <grpcpp/server_context.h>
#include <grpcpp/support/server_callback.h>

#include <boost/asio/any_io_executor.hpp>
#include <boost/asio/post.hpp>
#include <string_view>

#include "server/api/api_context.h"
#include "server/api/to_proto.h"

namespace kinevox {

// A call's credentials; empty if there are none. The guard rejects calls with two.
inline std::string_view authorization_of(const grpc::ServerContextBase& context) {
    const auto found = context.client_metadata().find("authorization");
    return found == context.client_metadata().end()
               ? std::string_view()
               : std::string_view(found->second.data(), found->second.size());
}

// Runs `handler` on `thread`, which is not gRPC's, if `check` succeeds. gRPC keeps request and response until
// Finish().
template <typename Request, typename Response>
grpc::ServerUnaryReactor* unary_call(const ApiContext& api, const boost::asio::any_io_executor& thread,
                                     grpc::CallbackServerContext* context, const Request* request,
                                     Response* response, absl::Status (*check)(const ApiContext&),
                                     absl::Status (*handler)(const ApiContext&, const Request&, Response&)) {
    grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
    if (const absl::Status refused = check(api); !refused.ok()) {
        reactor->Finish(to_grpc(refused));
        return reactor;
    }
    boost::asio::post(thread, [&api, reactor, request, response, handler] {
        reactor->Finish(to_grpc(handler(api, *request, *response)));
    });
    return reactor;
}

// Finishes a call at once.
inline grpc::ServerUnaryReactor* answer(grpc::CallbackServerContext* context, const absl::Status& status) {
    grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
    reactor->Finish(to_grpc(status));
    return reactor;
}

}  // namespace kinevox
