// Timeline of a replay: play, pause, step, speed, loop, and return to the cameras.
#pragma once

#include <QToolBar>

#include "kinevox/v1/replay_service.pb.h"

class QAction;
class QComboBox;
class QLabel;
class QSlider;

namespace kinevox::viewer {

class ReplayBar final : public QToolBar {
    Q_OBJECT

  public:
    explicit ReplayBar(QWidget* parent = nullptr);
    void show_replay(const v1::Replay& replay);
    bool playing() const { return playing_; }

  signals:
    void play(bool on);
    void step(int frames);
    void seek(qint64 frame);
    void speed(double factor);
    void loop(bool on);
    void close_replay();

  private:
    QAction *play_, *loop_;
    QSlider* timeline_;
    QLabel* position_;
    QComboBox* speed_;
    bool playing_ = false;
};

}  // namespace kinevox::viewer
