// The ghost: a second trial chosen by the coach, read beside everything else, and laid over what is shown.
#pragma once

#include <QObject>
#include <QString>
#include <memory>
#include <mutex>
#include <string>

#include "client/viewer/commands.h"
#include "client/viewer/feed.h"
#include "client/viewer/ghost_match.h"

namespace kinevox::viewer {

class GhostBar;

// The window's thread, but for what reads.
class Ghost final : public QObject {
    Q_OBJECT

  public:
    Ghost(const client::ClientOptions& options, GhostBar& bar);

    void choose_recording(const std::string& name);
    void choose_file(const QString& file);
    // What is replayed, from its mark or else from where it stands; nothing happens live.
    void choose_replayed();
    void none();

    void show_state(const DaemonState& state);
    // The ghost as it belongs to the newest pose; keeps that for mark().
    std::shared_ptr<const ShownPose> pose_for(std::shared_ptr<const ShownPose> shown);
    // The ghost's event belongs to what is shown now.
    void mark();
    // The ghost with what was shown last, after a choice.
    std::shared_ptr<const ShownPose> pose() const;
    const GhostMatch& match() const { return match_; }

  signals:
    void changed();  // pose() is another
    void answered(const QString& message, bool good);
    void read_(bool ghost);  // on the reading thread

  private:
    void choose(std::function<absl::StatusOr<GhostTrial>(client::Client&)> read, const QString& what,
                bool ghost);
    void take(bool ghost);
    void read_replayed();

    GhostBar& bar_;
    GhostMatch match_;
    std::shared_ptr<const ShownPose> shown_;
    std::string replayed_, replay_session_;  // the recording's name; empty: live or another session
    double replay_fps_ = 0;
    std::optional<double> wanted_mark_s_;  // of the ghost that is being read
    std::string shown_read_of_;

    std::mutex mutex_;
    std::shared_ptr<const GhostTrial> read_ghost_, read_shown_;
    Commands reading_;
};

}  // namespace kinevox::viewer
