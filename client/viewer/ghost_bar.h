// Toolbar of the ghost: the aligned events of ghost and current trial, the offset, and pelvis alignment.
#pragma once

#include <QToolBar>

#include "client/viewer/ghost_trial.h"

class QAction;
class QCheckBox;
class QComboBox;
class QDoubleSpinBox;
class QLabel;

namespace kinevox::viewer {

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

}  // namespace kinevox::viewer
