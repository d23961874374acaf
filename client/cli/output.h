// What the commands print: JSON for scripts, tables and texts for people.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>
#include <google/protobuf/message.h>

#include <chrono>
#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "client/cli/verbs.h"
#include "kinevox/v1/calibration_service.pb.h"
#include "kinevox/v1/capture_service.pb.h"

namespace kinevox::cli {

// The API's messages as JSON for scripts: field names as in the .proto, numbers as numbers (64-bit ones too),
// enums by their short name in lower case, durations as seconds under NAME_s, timestamps in RFC 3339, NaN and
// absent values as null, bytes by their length.
nlohmann::ordered_json to_json(const google::protobuf::Message& message);

// NaN and infinities as null.
nlohmann::ordered_json number_or_null(double value);

// CAPTURE_STATE_RUNNING of CaptureState becomes "running".
std::string short_name(const google::protobuf::EnumValueDescriptor& value);

// Tables of text with a header line, columns as wide as their widest cell.
class Table {
  public:
    // A header that begins with '>' aligns its column to the right.
    explicit Table(const std::vector<std::string>& headers);
    void add(std::vector<std::string> cells);
    std::string text() const;  // lines without blanks at their ends; no newline at the end

  private:
    std::vector<bool> right_;
    std::vector<std::vector<std::string>> rows_;
};

// "1 frame", "2 frames".
std::string count_of(std::uint64_t count, const std::string& noun);

// The response of a call: as JSON with --json, else the text.
template <typename Response>
absl::Status report(const GlobalOptions& global, const absl::StatusOr<Response>& response,
                    const std::function<std::string(const Response&)>& text) {
    if (!response.ok()) return response.status();
    print_line(global.json ? to_json(*response).dump() : text(*response));
    return absl::OkStatus();
}

// A status as text for people: several lines, no newline at the end. `status` prints it once, `watch` on a
// terminal again and again.
std::string status_text(const v1::GetStatusResponse& status);

// One line, for `watch` into a pipe.
std::string status_line(const v1::GetStatusResponse& status);

// A certificate's verdict and its findings, then a table of the cameras; no newline at the end.
std::string certificate_text(const v1::Certificate& certificate);

// A procedure's progress: a line on standard output whenever the next hint changes, at most once in two
// seconds; where standard error is a terminal, a line there that is redrawn.
class ProcedureText {
  public:
    // False when nothing reads standard output any more.
    bool print(const v1::WatchProcedureResponse& progress);

  private:
    std::string last_;
    std::chrono::steady_clock::time_point printed_{};
};

}  // namespace kinevox::cli
