// What the coach asks the daemon to do, one after the other on a thread of its own, so that the window never
// waits.
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

inline constexpr const char* kOperator = "viewer";  // under which control is taken

// Signals come on the thread here.
class Commands final : public QObject {
    Q_OBJECT

  public:
    static constexpr std::size_t kMaxWaiting = 8;

    explicit Commands(client::ClientOptions options);
    ~Commands() override;

    // `act` returns what to tell the coach, or why it failed. False where too much waits already.
    bool ask(const QString& what, std::function<absl::Status(client::Client&, std::string& done)> act);

    bool start_capture();
    bool stop_capture();
    // Of so many live frame sets, 0: the source's own clip.
    bool learn_background(int frames);
    bool start_recording();
    bool stop_recording();
    bool keep_last();
    // Answered by recordings_came().
    bool list_recordings();
    bool open_replay(const std::string& recording);  // its name
    bool close_replay();
    bool play(bool on);
    bool step(int frames);
    bool seek(std::int64_t frame);
    bool set_speed(double speed);
    bool set_loop(bool on);

    // Since when nothing waits and nothing is under way; nothing while something does.
    std::optional<std::chrono::steady_clock::time_point> idle_since() const;

  signals:
    void begun(const QString& what);
    void done(const QString& message);
    void failed(const QString& message);
    // Newest first; `texts` for people, in the same order.
    void recordings_came(const QStringList& names, const QStringList& texts);

  private:
    struct Asked {
        QString what;
        std::function<absl::Status(client::Client&, std::string&)> act;
    };
    void run(const std::stop_token& stop);

    const client::ClientOptions options_;
    mutable std::mutex mutex_;
    std::condition_variable_any changed_;
    std::optional<std::chrono::steady_clock::time_point> idle_since_ = std::chrono::steady_clock::now();
    std::deque<Asked> asked_;
    std::jthread thread_;
};

}  // namespace kinevox::viewer
