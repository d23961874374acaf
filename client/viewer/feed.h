// What comes from the daemon: streams and states, each on a thread of its own, the newest kept. Nothing here
// waits for the painting, and the painting waits for nothing here.
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
#include "client/viewer/status_words.h"
#include "common/camera.h"

namespace kinevox::viewer {

// The newest of each state; null: none has come yet.
struct DaemonState {
    std::shared_ptr<const v1::GetStatusResponse> status;
    std::shared_ptr<const v1::GetRecorderStatusResponse> recorder;
    std::shared_ptr<const v1::Replay> replay;
    std::chrono::steady_clock::time_point asked_at;  // all that is in it was so then or later
};

enum class PreviewKind { kNone, kPictures, kSilhouettes };

// Signals come on the threads here: connect them to objects, whose threads they are then queued to. Many
// messages may stand behind one signal.
class Feed final : public QObject {
    Q_OBJECT

  public:
    // Connects, and again whenever the daemon is gone, until it is destroyed.
    explicit Feed(client::ClientOptions options);
    ~Feed() override;

    std::shared_ptr<const ShownVolume> volume() const;
    // Those that came since the last call, oldest first; the newest 512 at most.
    std::vector<std::shared_ptr<const ShownPose>> take_poses();
    DaemonState state() const;
    std::vector<Camera> cameras() const;
    std::map<std::string, QImage> previews() const;  // by camera
    // Without delay and painted rate, which the painting knows.
    Link link() const;

    // Of all cameras, five a second; none costs nothing.
    void show_previews(PreviewKind kind);

  signals:
    void volume_came();
    void poses_came();
    void state_came();
    void cameras_came();
    void preview_came();
    void previews_refused(const QString& why);  // to this connection's token; not asked for again
    void event_came(int kind, const QString& message, qint64 time_ns);  // v1::EventKind; UTC

  private:
    using Clock = std::chrono::steady_clock;
    void until(const std::stop_token& stop, const std::function<absl::Status()>& stream);
    void run_volumes(const std::stop_token& stop);
    void run_poses(const std::stop_token& stop);
    void run_states(const std::stop_token& stop);
    void run_events(const std::stop_token& stop);
    void run_preview(const std::string& camera, PreviewKind kind, const std::stop_token& stop);
    void alive();

    const client::ClientOptions options_;
    mutable std::mutex mutex_;
    std::shared_ptr<const ShownVolume> volume_;
    std::vector<std::shared_ptr<const ShownPose>> poses_;
    DaemonState state_;
    std::vector<Camera> cameras_;
    std::map<std::string, QImage> previews_;
    bool connected_ = false;
    std::string problem_ = "connecting";
    Clock::time_point last_message_ = Clock::now();
    PreviewKind preview_kind_ = PreviewKind::kNone;

    std::condition_variable_any wake_;
    std::vector<std::jthread> preview_threads_;  // the owner's thread starts and ends them
    std::vector<std::jthread> threads_;
};

}  // namespace kinevox::viewer
