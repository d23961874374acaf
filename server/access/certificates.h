// A private certificate authority and the certificates it signs, as PEM.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <string>
#include <vector>

namespace kinevox {

struct CertificateAndKey {
    std::string certificate, key;
};

struct NewCertificate {
    enum class Kind { kAuthority, kServer, kClient };
    Kind kind = Kind::kServer;
    std::string name;                      // its subject's common name
    std::vector<std::string> hosts;        // of a server: names and addresses that clients connect to
    std::int64_t from_s = 0, until_s = 0;  // seconds since 1970, UTC
};

// A key on the curve P-256 and its certificate, signed by `authority`; null: self-signed.
absl::StatusOr<CertificateAndKey> make_certificate(const NewCertificate& wanted,
                                                   const CertificateAndKey* authority);

// Expiry of the first certificate in `certificate`. InvalidArgument if it cannot be read, FailedPrecondition
// if `key` is not empty and not its key.
absl::StatusOr<std::int64_t> check_certificate(const std::string& certificate, const std::string& key);

}  // namespace kinevox
