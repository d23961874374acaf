// Decides, before anything of a call runs, whether it may; counts streams, and ends those whose token is no
// longer valid.
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
    double requests_per_s = 200;  // of one token; as many at once
};

// Who calls. `digest` tells tokens apart that had the same name one after the other.
struct Caller {
    std::string name = "anyone";
    v1::Role role = v1::ROLE_ADMINISTER;
    std::string digest;
};

// Any thread. `authorization` is what a call brings: "Bearer kvx_...".
class Guard {
  public:
    // Empty `tokens`: there are none, and everybody may do everything. Otherwise that file is read here, and
    // again whenever it has changed; while it cannot be read no token is valid. `audit` may be null, and
    // outlives the guard.
    static absl::StatusOr<std::unique_ptr<Guard>> create(const std::filesystem::path& tokens,
                                                         const AccessLimits& limits,
                                                         AuditLog* audit = nullptr);
    ~Guard();

    bool open() const;  // everybody may do everything
    AuditLog* audit() const;

    // Before the server starts: the services that it has. Calls of others are refused.
    void set_services(const std::vector<std::string>& full_names);
    const CallTable& calls() const;

    // Whether a call may begin, and counts it: Unauthenticated, PermissionDenied, ResourceExhausted;
    // Unimplemented where there is no such call. What is refused is audited.
    absl::Status admit(std::string_view path, std::string_view authorization);
    // The same as above without counting.
    absl::StatusOr<Caller> identify(std::string_view authorization) const;
    // Whether the caller has a permission that depends on what a call asks for; audited where not.
    absl::Status allow(std::string_view authorization, v1::Permission permission,
                       std::string_view method) const;

    // Counted as a stream until it is destroyed. `end` is called once, from tick(), when the token stops
    // being valid; it may still be called while the stream is being destroyed. ResourceExhausted where there
    // are as many as there may be.
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
