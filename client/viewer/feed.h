// Streams and states of the daemon, each read on a thread of its own; the latest of each is kept. Reading and
// painting never wait for each other.
#pragma once

#include <absl/status/status.h>

#include <QImage>
#include <QObject>
#include <QString>
#include <chrono>
#include <condition_variable>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "client/lib/client.h"
#include "client/viewer/shown.h"
#include "common/camera.h"
#include "common/stopwatch.h"
#include "kinevox/v1/capture_service.pb.h"
#include "kinevox/v1/recording_service.pb.h"
#include "kinevox/v1/replay_service.pb.h"

namespace kinevox::viewer {

// The state of capture, cameras and recording as text for the status line; in status_text.cc.
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

// The latest of each state; null: not received yet.
struct DaemonState {
    std::shared_ptr<const v1::GetStatusResponse> status;
    std::shared_ptr<const v1::GetRecorderStatusResponse> recorder;
    std::shared_ptr<const v1::Replay> replay;
    std::chrono::steady_clock::time_point requested_at;  // before the calls; the state is not older
};

enum class PreviewKind { kNone, kImages, kSilhouettes };

// Signals are emitted on threads of this object; connect them with a receiver, so that Qt queues them to its
// thread. One signal may stand for several messages.
class Feed final : public QObject {
    Q_OBJECT

  public:
    // Connects, and reconnects until it is destroyed.
    explicit Feed(client::ClientOptions options);
    ~Feed() override;

    std::shared_ptr<const ShownVolume> volume() const;
    // Poses received since the last call, oldest first; at most the latest 512.
    std::vector<std::shared_ptr<const ShownPoses>> take_poses();
    DaemonState state() const;
    std::vector<Camera> cameras() const;
    std::map<std::string, QImage> previews() const;  // by camera
    // Without latency_ms, which the scene measures.
    ConnectionStatus connection() const;

    // Of all cameras, five per second.
    void show_previews(PreviewKind kind);

  signals:
    void volume_received();
    void poses_received();
    void state_received();
    void cameras_received();
    void preview_received();
    void previews_denied(const QString& why);  // to the role of this token; not retried
    void event_received(int kind, const QString& message, qint64 time_ns,
                        quint32 subject_id);  // v1::EventKind; UTC; 0: no subject

  private:
    void run_until_stopped(const std::stop_token& stop, const std::function<absl::Status()>& stream);
    void run_volumes(const std::stop_token& stop);
    void run_poses(const std::stop_token& stop);
    void run_states(const std::stop_token& stop);
    void run_events(const std::stop_token& stop);
    void run_preview(const std::string& camera, PreviewKind kind, const std::stop_token& stop);
    void mark_alive();

    const client::ClientOptions options_;
    mutable std::mutex mutex_;
    std::shared_ptr<const ShownVolume> volume_;
    std::vector<std::shared_ptr<const ShownPoses>> poses_;
    DaemonState state_;
    std::vector<Camera> cameras_;
    std::map<std::string, QImage> previews_;
    bool connected_ = false;
    std::string error_message_ = "connecting";
    Stopwatch since_message_;
    PreviewKind preview_kind_ = PreviewKind::kNone;

    std::condition_variable_any wake_;
    std::vector<std::jthread> preview_threads_;  // started and ended on the owner's thread
    std::vector<std::jthread> threads_;
};

}  // namespace kinevox::viewer
