#include "client/lib/connection.h"

#include <fmt/format.h>

#include <algorithm>
#include <initializer_list>
#include <string>

namespace kinevox::client {
namespace {

std::shared_ptr<grpc::ChannelCredentials> credentials(const Security& security) {
    if (!security.tls) return grpc::InsecureChannelCredentials();
    return grpc::SslCredentials({.pem_root_certs = security.ca_pem,
                                 .pem_private_key = security.key_pem,
                                 .pem_cert_chain = security.certificate_pem});
}

bool contains_any(const std::string& text, std::initializer_list<const char*> words) {
    return std::ranges::any_of(words, [&](const char* word) { return text.find(word) != std::string::npos; });
}

// Why there is no connection, and the remedy, from the words of gRPC and OpenSSL.
std::string connection_remedy(const std::string& message, const Security& security) {
    if (security.tls && message.find("wrong version number") != std::string::npos)
        return "the daemon does not use TLS; omit --tls, --ca, --certificate, --key and --server-name";
    if (message.find("certificate verify failed") != std::string::npos)
        return "TLS: the daemon's certificate is not signed by a trusted CA; give its ca.pem with --ca";
    if (message.find("not in peer certificate") != std::string::npos)
        return "TLS: the daemon's certificate is for another host name; give it with --server-name";
    const bool closed = contains_any(message, {"Socket closed", "Connection reset", "Broken pipe"});
    if (security.tls && (closed || message.find("handshake failed") != std::string::npos))
        return security.certificate_pem.empty()
                   ? "the TLS handshake failed; if the daemon requires a client certificate, give "
                     "--certificate "
                     "and --key"
                   : "the TLS handshake failed; the client certificate must be signed by the daemon's CA";
    if (closed) return "the daemon closed the connection; if it uses TLS, give --tls or --ca";
    return "start kinevoxd there, or give another --server";
}

}  // namespace

std::shared_ptr<grpc::Channel> connect(const ClientOptions& options) {
    grpc::ChannelArguments arguments;
    if (!options.security.server_name.empty())
        arguments.SetSslTargetNameOverride(options.security.server_name);
    arguments.SetMaxReceiveMessageSize(256 << 20);  // a 16-camera hall at 2 mm is large
    arguments.SetInt(GRPC_ARG_KEEPALIVE_TIME_MS, 20'000);
    arguments.SetInt(GRPC_ARG_INITIAL_RECONNECT_BACKOFF_MS, 200);
    arguments.SetInt(GRPC_ARG_MAX_RECONNECT_BACKOFF_MS, 2'000);
    return grpc::CreateCustomChannel(options.server, credentials(options.security), arguments);
}

void prepare_context(grpc::ClientContext& context, const ClientOptions& options) {
    if (!options.security.token.empty())
        context.AddMetadata("authorization", "Bearer " + options.security.token);
}

absl::Status to_absl(const grpc::Status& status, const ClientOptions& options) {
    if (status.ok()) return absl::OkStatus();
    // gRPC's status of a call to a server that is stopping. As CANCELLED it would be taken for a cancellation
    // by this client: no error, no reconnection.
    if (status.error_code() == grpc::StatusCode::CANCELLED)
        return absl::UnavailableError(fmt::format(
            "the daemon at {} ended the call because it is stopping; connect again later", options.server));
    const auto code = static_cast<absl::StatusCode>(status.error_code());
    std::string message = status.error_message();
    std::ranges::replace(message, '\n', ' ');
    const bool from_daemon = message.find("daemon") != std::string::npos;  // else gRPC's words
    if (code == absl::StatusCode::kUnavailable && !from_daemon)
        message = fmt::format("cannot connect to a daemon at {} ({}); {}", options.server, message,
                              connection_remedy(message, options.security));
    else if (code == absl::StatusCode::kDeadlineExceeded)
        message = fmt::format("the daemon at {} did not answer in time; try again, or raise --timeout",
                              options.server);
    else if (code == absl::StatusCode::kUnimplemented)
        message = fmt::format("the server at {} is not a Kinevox daemon of this version ({})", options.server,
                              message);
    return {code, message};
}

}  // namespace kinevox::client
