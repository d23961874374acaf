// A call's credentials.
#pragma once

#include <grpcpp/server_context.h>

#include <string_view>

namespace kinevox {

// Empty if there is none. The guard rejects calls with two.
inline std::string_view authorization_of(const grpc::ServerContextBase& context) {
    const auto found = context.client_metadata().find("authorization");
    return found == context.client_metadata().end()
               ? std::string_view()
               : std::string_view(found->second.data(), found->second.size());
}

}  // namespace kinevox
