#include "client/viewer/replay_bar.h"

#include <QAction>
#include <QComboBox>
#include <QLabel>
#include <QSignalBlocker>
#include <QSlider>
#include <algorithm>
#include <cmath>

#include "client/viewer/feed.h"

namespace kinevox::viewer {
namespace {

constexpr double kSpeeds[] = {0.05, 0.1, 0.25, 0.5, 1, 2};

}  // namespace

ReplayBar::ReplayBar(QWidget* parent) : QToolBar(tr("Replay"), parent) {
    setObjectName("replay");
    addAction(tr("|◀"), this, [this] { emit seek(0); })->setToolTip(tr("To the start"));
    addAction(tr("−1"), this, [this] { emit step(-1); })->setToolTip(tr("Previous frame (Left)"));
    play_ = addAction(tr("Play"), this, [this] { emit play(!playing_); });
    play_->setToolTip(tr("Play or pause (Space)"));
    addAction(tr("+1"), this, [this] { emit step(1); })->setToolTip(tr("Next frame (Right)"));
    timeline_ = new QSlider(Qt::Horizontal, this);
    timeline_->setTracking(true);
    connect(timeline_, &QSlider::valueChanged, this, [this](int frame) { emit seek(frame); });
    addWidget(timeline_);
    position_ = new QLabel(this);
    position_->setMinimumWidth(150);
    position_->setAlignment(Qt::AlignCenter);
    addWidget(position_);
    speed_ = new QComboBox(this);
    for (const double s : kSpeeds) speed_->addItem(QString("× %1").arg(s), s);
    speed_->setCurrentIndex(static_cast<int>(std::ranges::find(kSpeeds, 1.0) - kSpeeds));
    speed_->setToolTip(tr("Playback speed"));
    connect(speed_, &QComboBox::activated, this, [this] { emit speed(speed_->currentData().toDouble()); });
    addWidget(speed_);
    loop_ = addAction(tr("Loop"), this, [this](bool on) { emit loop(on); });
    loop_->setCheckable(true);
    addAction(tr("Return to cameras"), this, [this] { emit close_replay(); });
    setMovable(false);
}

void ReplayBar::show_replay(const v1::Replay& replay) {
    const bool open = replayed(&replay);
    setVisible(open);
    if (!open) return;
    playing_ = replay.state() == v1::REPLAY_STATE_PLAYING;
    play_->setText(playing_ ? tr("Pause") : tr("Play"));
    const QSignalBlocker quiet_timeline(timeline_), quiet_loop(loop_);
    timeline_->setRange(0, static_cast<int>(std::max<std::int64_t>(0, replay.frame_count() - 1)));
    if (!timeline_->isSliderDown())
        timeline_->setValue(static_cast<int>(std::max<std::int64_t>(0, replay.frame())));
    loop_->setChecked(replay.loop());
    if (const int at = speed_->findData(replay.speed()); at >= 0) speed_->setCurrentIndex(at);
    position_->setText(tr("%1 s   frame %2 of %3")
                           .arg(replay.position_s(), 0, 'f', 2)
                           .arg(replay.frame() + 1)
                           .arg(replay.frame_count()));
}

}  // namespace kinevox::viewer
