// Authorises each call before it runs; counts streams, and ends those whose token is no longer valid.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "kinevox/v1/access.pb.h"

namespace kinevox {

class AuditLog;
class CallTable;

struct AccessLimits {
    int max_streams = 1000;
    int max_streams_per_token = 250;
    double max_requests_per_s = 200;  // per token, also the burst size
};

// `digest` distinguishes successive tokens of the same name.
struct Caller {
    std::string name = "anyone";
    v1::Role role = v1::ROLE_ADMIN;
    std::string digest;
};

// Any thread. `authorization` is the header of a call: "Bearer kvx_...".
class Guard {
  public:
    // Empty `tokens`: none, every client has full access. Otherwise the file is read here and whenever it has
    // changed; while it cannot be read, all tokens are rejected. `audit` may be null, and outlives the guard.
    static absl::StatusOr<std::unique_ptr<Guard>> create(const std::filesystem::path& tokens,
                                                         const AccessLimits& limits,
                                                         AuditLog* audit = nullptr);
    ~Guard();

    bool open() const;  // every client has full access
    AuditLog* audit() const;

    // Before the server starts: its services. Calls of others are refused.
    void set_services(const std::vector<std::string>& full_names);
    const CallTable& calls() const;

    // Authorises and counts a call: Unauthenticated, PermissionDenied, ResourceExhausted; Unimplemented for
    // an unknown method. Refusals are audited.
    absl::Status admit(std::string_view path, std::string_view authorization);
    // The same without counting.
    absl::StatusOr<Caller> identify(std::string_view authorization) const;
    // Checks a permission that depends on the request; refusals are audited.
    absl::Status allow(std::string_view authorization, v1::Permission permission,
                       std::string_view method) const;

    // Counted as a stream until it is destroyed. `end` is called once, from tick(), when the token becomes
    // invalid; it may still be called while the stream is being destroyed. ResourceExhausted at the limit.
    class Stream;
    absl::StatusOr<std::shared_ptr<Stream>> open_stream(std::string_view authorization,
                                                        std::function<void(const absl::Status&)> end);
    int streams() const;

    // Once a second: reads the tokens where they have changed, ends streams.
    void tick();

  private:
    struct Parts;
    explicit Guard(std::shared_ptr<Parts> parts);
    std::shared_ptr<Parts> parts_;
};

class Guard::Stream {
  public:
    ~Stream();
    Stream(const Stream&) = delete;
    Stream& operator=(const Stream&) = delete;

  private:
    friend class Guard;
    Stream(std::shared_ptr<Parts> parts, Caller caller, std::function<void(const absl::Status&)> end);
    std::shared_ptr<Parts> parts_;
    Caller caller_;
    std::function<void(const absl::Status&)> end_;
};

}  // namespace kinevox
