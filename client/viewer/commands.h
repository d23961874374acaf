// A queue of calls to the daemon on a thread of its own, so that the window never blocks.
#pragma once

#include <absl/status/status.h>

#include <QObject>
#include <QString>
#include <QStringList>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <functional>
#include <mutex>
#include <optional>
#include <string>
#include <thread>

#include "client/lib/client.h"

namespace kinevox::viewer {

inline constexpr const char* kOperatorName = "viewer";  // holder of control

// Signals are emitted on the thread of this object.
class Commands final : public QObject {
    Q_OBJECT

  public:
    static constexpr std::size_t kMaxPending = 8;

    explicit Commands(client::ClientOptions options);
    ~Commands() override;

    // `act` sets the message to show, or returns an error. False: too many commands are pending.
    bool enqueue(const QString& name, std::function<absl::Status(client::Client&, std::string& done)> act);

    bool start_capture();
    bool stop_capture();
    // Live frame sets to learn from; 0: the source's own background clip.
    bool learn_background(int frame_set_count);
    bool start_recording();
    bool stop_recording();
    bool save_buffer();
    // Emits recordings_received().
    bool list_recordings();
    bool open_replay(const std::string& recording_name);
    bool close_replay();
    bool play(bool on);
    bool step(int frames);
    bool seek(std::int64_t frame);
    bool set_speed(double speed);
    bool set_loop(bool on);

    // Since when no command is pending or running; empty while one is.
    std::optional<std::chrono::steady_clock::time_point> idle_since() const;

  signals:
    void started(const QString& name);
    void done(const QString& message);
    void failed(const QString& message);
    // Latest first; `labels` in the same order.
    void recordings_received(const QStringList& names, const QStringList& labels);

  private:
    struct Command {
        QString name;
        std::function<absl::Status(client::Client&, std::string&)> act;
    };
    void run(const std::stop_token& stop);

    const client::ClientOptions options_;
    mutable std::mutex mutex_;
    std::condition_variable_any changed_;
    std::optional<std::chrono::steady_clock::time_point> idle_since_ = std::chrono::steady_clock::now();
    std::deque<Command> pending_;
    std::jthread thread_;
};

}  // namespace kinevox::viewer
