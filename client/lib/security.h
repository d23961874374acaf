// TLS, trusted CAs, client certificate and token of the connection to a daemon.
#pragma once

#include <absl/status/statusor.h>

#include <string>

namespace kinevox::client {

// Contents of the files below. The default, no TLS and no token, suits a daemon on this machine.
struct Security {
    bool tls = false;
    std::string ca_pem;  // CAs that may have signed the daemon's certificate; empty: the system's
    std::string certificate_pem,
        key_pem;              // of the client, for daemons that require it (mutual TLS); empty: none
    std::string server_name;  // expected name in the daemon's certificate; empty: HOST
    std::string token;        // sent with each call; empty: none
};

// As users give it. Any file but the token's implies TLS.
struct SecurityFiles {
    bool tls = false;
    std::string ca, certificate, key;  // PEM
    std::string server_name;
    std::string token;  // its first line is the token
};

// InvalidArgument or NotFound with the file and the remedy. A token without TLS is refused unless `server`
// (HOST:PORT) is on this machine: it would be sent unencrypted.
absl::StatusOr<Security> read_security(const SecurityFiles& files, const std::string& server);

}  // namespace kinevox::client
