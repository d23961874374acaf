// How a daemon beyond this machine is spoken to: TLS, who is trusted, and who one is oneself.
#pragma once

#include <absl/status/statusor.h>

#include <string>

namespace kinevox::client {

// What is read from the files below. The default: no TLS, no token, as a daemon on this machine wants it.
struct Security {
    bool tls = false;
    std::string ca_pem;  // who may have signed the daemon's certificate; empty: this machine's authorities
    std::string certificate_pem, key_pem;  // one's own, for daemons that ask for it (mutual TLS); empty: none
    std::string server_name;  // the name in the daemon's certificate; empty: the HOST that is connected to
    std::string token;        // goes with each call; empty: none
};

// As users give it. A file that is named means TLS, but for the token's.
struct SecurityFiles {
    bool tls = false;
    std::string ca, certificate, key;  // PEM
    std::string server_name;
    std::string token;  // its first line is the token
};

// InvalidArgument or NotFound with the file and the remedy. A token is refused without TLS where `server`
// (HOST:PORT) is not on this machine: anyone on the way could take it.
absl::StatusOr<Security> read_security(const SecurityFiles& files, const std::string& server);

}  // namespace kinevox::client
