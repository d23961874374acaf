// Audit log: one JSON line per operating or refused call.
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
    std::string caller;  // name of the token; "anyone" without tokens; empty if unknown
    std::string role;
    std::string peer;     // "ipv4:192.168.1.7:50312"; empty if unknown
    std::string method;   // "CaptureService.StartCapture"
    std::string outcome;  // "OK", "FAILED_PRECONDITION"
    std::string message;  // of the status; empty if OK
    std::string request;  // summary as JSON; empty if unknown
};

// Any thread; callers do not wait for the disk: a thread writes the queue, and if the queue overflows a line
// has the number of lost lines. The file is reopened for each batch, so that it may be moved.
class AuditLog {
  public:
    // Empty `file`: the daemon's log only. Unavailable if it cannot be written.
    static absl::StatusOr<std::unique_ptr<AuditLog>> open(const std::filesystem::path& file);
    ~AuditLog();  // writes the queue

    void add(const AuditEntry& entry);
    // Refused before it reached the service: a few per second are written, the others are counted.
    void add_refused(const AuditEntry& entry);

  private:
    struct Parts;
    explicit AuditLog(std::unique_ptr<Parts> parts);
    std::unique_ptr<Parts> parts_;
};

// The fields that are set, as JSON: long texts truncated, bytes counted, without lease ids.
std::string request_summary(const google::protobuf::Message& request);

}  // namespace kinevox
