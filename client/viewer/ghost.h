// The ghost: a second trial, read in the background and drawn over the current one; and its toolbar.
#pragma once

#include <QObject>
#include <QString>
#include <QToolBar>
#include <memory>
#include <mutex>
#include <string>

#include "client/viewer/commands.h"
#include "client/viewer/feed.h"
#include "client/viewer/ghost_match.h"

class QAction;
class QCheckBox;
class QComboBox;
class QDoubleSpinBox;
class QLabel;

namespace kinevox::viewer {

// Toolbar of the ghost: the aligned events of ghost and current trial, the offset, and pelvis alignment.
class GhostBar final : public QToolBar {
    Q_OBJECT

  public:
    explicit GhostBar(QWidget* parent = nullptr);
    // Shows the bar with the default choices for a new ghost.
    void show_ghost(const QString& name, TrialEvent ghost_event, TrialEvent shown_event);
    void show_problem(const std::string& lack);
    void shift(int steps);  // moves the ghost ahead by steps of the offset

    TrialEvent ghost_event() const;
    TrialEvent shown_event() const;
    void set_shown_event(TrialEvent event);
    double offset_s() const;
    bool align_pelvis() const;

  signals:
    void changed();
    void closed();

  private:
    QComboBox* make_events();

    QLabel *name_, *problem_;
    QComboBox *ghost_event_, *shown_event_;
    QDoubleSpinBox* offset_;
    QCheckBox* align_pelvis_;
};

// Used on the window's thread; trials are read on another one.
class Ghost final : public QObject {
    Q_OBJECT

  public:
    Ghost(const client::ClientOptions& options, GhostBar& bar);

    void choose_recording(const std::string& name);
    void choose_file(const QString& file);
    // The replayed recording, from its mark or else from the current frame; fails while live.
    void choose_replayed();
    void clear();

    void show_state(const DaemonState& state);
    // The ghost for the latest pose, which is stored for mark().
    std::shared_ptr<const ShownPose> pose_for(std::shared_ptr<const ShownPose> shown);
    // Aligns the ghost's event with the current pose.
    void mark();
    // The ghost for the stored pose.
    std::shared_ptr<const ShownPose> pose() const;
    const GhostMatch& match() const { return match_; }

  signals:
    void changed();  // pose() has changed
    void reported(const QString& message, bool ok);
    void trial_read(bool ghost);  // on the reading thread

  private:
    void choose(std::function<absl::StatusOr<GhostTrial>(client::Client&)> read, const QString& what,
                bool ghost);
    void take(bool ghost);
    void read_replayed();

    GhostBar& bar_;
    GhostMatch match_;
    std::shared_ptr<const ShownPose> shown_;
    std::string replayed_, replay_session_;  // name of the recording; empty: live or another session
    double replay_fps_ = 0;
    std::optional<double> pending_mark_s_;  // of the ghost being read
    std::string shown_recording_;

    std::mutex mutex_;
    std::shared_ptr<const GhostTrial> read_ghost_, read_shown_;
    Commands reading_;
};

}  // namespace kinevox::viewer
