// The ghost's line of choices: of which trial, which event of it on which event of what is shown, how far
// apart.
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
    // As it is offered first for a ghost that was just chosen.
    void show_ghost(const QString& name, TrialEvent ghost_event, TrialEvent shown_event);
    void show_lack(const std::string& lack);
    void shift(int steps);  // the ghost ahead by so many steps of the offset

    TrialEvent ghost_event() const;
    TrialEvent shown_event() const;
    void set_shown_event(TrialEvent event);
    double offset_s() const;
    bool on_pelvis() const;

  signals:
    void changed();
    void closed();

  private:
    QComboBox* make_events();

    QLabel *name_, *lack_;
    QComboBox *ghost_event_, *shown_event_;
    QDoubleSpinBox* offset_;
    QCheckBox* on_pelvis_;
};

}  // namespace kinevox::viewer
