// The state of capture, cameras and recording as text for the status line.
#pragma once

#include <optional>
#include <string>

#include "kinevox/v1/capture_service.pb.h"
#include "kinevox/v1/recording_service.pb.h"
#include "kinevox/v1/replay_service.pb.h"

namespace kinevox::viewer {

struct ConnectionStatus {
    std::string server;                // HOST:PORT
    bool connected = false;            // the latest call or message succeeded
    std::string error_message;         // if not connected; one line
    double idle_s = 0;                 // since the latest message of any kind
    std::optional<double> latency_ms;  // from the capture to the painted image, median
};

enum class Severity { kOk, kWarning, kError };

struct StatusText {
    Severity severity = Severity::kOk;
    std::string state;   // one or two words: "Live", "Stopped", "Replay"
    std::string line;    // rate, latency, cameras
    std::string remedy;  // the worst problem and its remedy; empty: none
};

// Whether a recording replaces the cameras.
bool replayed(const v1::Replay* replay);

struct CameraIssue {
    std::string label;  // over its image
    std::string text;   // with the remedy
    int severity = 0;   // 0: no issue; larger is worse
};
// `tracked`: there is a subject, so that cameras can be inconsistent.
CameraIssue camera_issue(const v1::CameraStatus& camera, bool tracked);

// `status`, `recorder`, `replay`: the latest; null: none received yet.
StatusText describe_status(const ConnectionStatus& connection, const v1::GetStatusResponse* status,
                           const v1::GetRecorderStatusResponse* recorder, const v1::Replay* replay);

}  // namespace kinevox::viewer
