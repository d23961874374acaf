// One JSON line for each operating call and each call that was refused.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

namespace google::protobuf {
class Message;
}

namespace kinevox {

struct AuditEntry {
    std::string who;  // the token's name; "anyone" without tokens; empty where nobody is known
    std::string role;
    std::string peer;     // "ipv4:192.168.1.7:50312"; empty where it is not known
    std::string method;   // "CaptureService.Start"
    std::string outcome;  // "OK", "FAILED_PRECONDITION"
    std::string message;  // of the status; empty where it is OK
    std::string request;  // its essence as JSON; empty where it is not known
};

// Any thread; nothing waits for the disk: a thread writes what is queued, and where more comes than the queue
// holds the file says how many lines are missing. The file is opened anew for each batch, so that it may be
// moved away.
class AuditLog {
  public:
    // Empty `file`: the daemon's log alone. Unavailable where it cannot be written.
    static absl::StatusOr<std::unique_ptr<AuditLog>> open(const std::filesystem::path& file);
    ~AuditLog();  // writes what is queued

    void add(const AuditEntry& entry);
    // Refused before it reached the service: a few a second are written, the rest is counted.
    void add_refused(const AuditEntry& entry);

  private:
    struct Parts;
    explicit AuditLog(std::unique_ptr<Parts> parts);
    std::unique_ptr<Parts> parts_;
};

// The fields that are set, as JSON: long texts cut, bytes counted, no lease's id.
std::string essence(const google::protobuf::Message& request);

}  // namespace kinevox
