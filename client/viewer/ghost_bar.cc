#include "client/viewer/ghost_bar.h"

#include <QCheckBox>
#include <QComboBox>
#include <QDoubleSpinBox>
#include <QLabel>
#include <QSignalBlocker>

namespace kinevox::viewer {
namespace {

constexpr double kOffsetStep_s = 0.02, kMaxOffset_s = 60;

}  // namespace

GhostBar::GhostBar(QWidget* parent) : QToolBar(tr("Ghost"), parent) {
    setObjectName("ghost");
    setMovable(false);
    name_ = new QLabel(this);
    ghost_event_ = make_events();
    shown_event_ = make_events();
    shown_event_->setObjectName("ghost_shown_event");
    ghost_event_->setObjectName("ghost_event");
    offset_ = new QDoubleSpinBox(this);
    offset_->setObjectName("ghost_offset");
    offset_->setRange(-kMaxOffset_s, kMaxOffset_s);
    offset_->setSingleStep(kOffsetStep_s);
    offset_->setSuffix(" s");
    offset_->setFocusPolicy(Qt::ClickFocus);
    offset_->setToolTip(tr("The ghost is so much ahead ( , and . )"));
    connect(offset_, &QDoubleSpinBox::valueChanged, this, &GhostBar::changed);
    on_pelvis_ = new QCheckBox(tr("pelvis on pelvis"), this);
    on_pelvis_->setToolTip(tr("The ghost is moved along the floor to where the athlete is"));
    on_pelvis_->setFocusPolicy(Qt::NoFocus);
    connect(on_pelvis_, &QCheckBox::toggled, this, &GhostBar::changed);
    lack_ = new QLabel(this);
    const auto word = [this](const QString& text) { addWidget(new QLabel("  " + text + " ", this)); };
    addWidget(name_);
    word(tr("its"));
    addWidget(ghost_event_);
    word(tr("on this one's"));
    addWidget(shown_event_);
    word(tr("ahead by"));
    addWidget(offset_);
    word("");
    addWidget(on_pelvis_);
    word("");
    addWidget(lack_);
    addAction(tr("No ghost"), this, &GhostBar::closed);
    hide();
}

QComboBox* GhostBar::make_events() {
    auto* events = new QComboBox(this);
    const std::pair<QString, TrialEvent> names[] = {{tr("begin"), TrialEvent::kBegin},
                                                    {tr("left foot down"), TrialEvent::kLeftFootDown},
                                                    {tr("right foot down"), TrialEvent::kRightFootDown},
                                                    {tr("highest point"), TrialEvent::kHighest},
                                                    {tr("lowest point"), TrialEvent::kLowest},
                                                    {tr("mark"), TrialEvent::kMark}};
    for (const auto& [name, event] : names) events->addItem(name, static_cast<int>(event));
    events->setFocusPolicy(Qt::ClickFocus);
    connect(events, &QComboBox::currentIndexChanged, this, &GhostBar::changed);
    return events;
}

void GhostBar::show_ghost(const QString& name, TrialEvent ghost_event, TrialEvent shown_event) {
    const QSignalBlocker quiet_ghost(ghost_event_), quiet_shown(shown_event_), quiet_offset(offset_);
    name_->setText(tr("Ghost: %1").arg(name));
    ghost_event_->setCurrentIndex(ghost_event_->findData(static_cast<int>(ghost_event)));
    shown_event_->setCurrentIndex(shown_event_->findData(static_cast<int>(shown_event)));
    offset_->setValue(0);
    show();
    emit changed();
}

void GhostBar::show_lack(const std::string& lack) {
    lack_->setText(QString::fromStdString(lack));
}

void GhostBar::shift(int steps) {
    offset_->setValue(offset_->value() + steps * kOffsetStep_s);
}

TrialEvent GhostBar::ghost_event() const {
    return static_cast<TrialEvent>(ghost_event_->currentData().toInt());
}
TrialEvent GhostBar::shown_event() const {
    return static_cast<TrialEvent>(shown_event_->currentData().toInt());
}
void GhostBar::set_shown_event(TrialEvent event) {
    shown_event_->setCurrentIndex(shown_event_->findData(static_cast<int>(event)));
}
double GhostBar::offset_s() const {
    return offset_->value();
}
bool GhostBar::on_pelvis() const {
    return on_pelvis_->isChecked();
}

}  // namespace kinevox::viewer
