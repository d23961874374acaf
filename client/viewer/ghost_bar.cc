#include <QCheckBox>
#include <QComboBox>
#include <QDoubleSpinBox>
#include <QLabel>
#include <QSignalBlocker>

#include "client/viewer/ghost.h"

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
    offset_->setToolTip(tr("Time by which the ghost is ahead ( , and . )"));
    connect(offset_, &QDoubleSpinBox::valueChanged, this, &GhostBar::changed);
    align_pelvis_ = new QCheckBox(tr("Align pelvis"), this);
    align_pelvis_->setToolTip(tr("Moves the ghost along the floor to the athlete's position"));
    align_pelvis_->setFocusPolicy(Qt::NoFocus);
    connect(align_pelvis_, &QCheckBox::toggled, this, &GhostBar::changed);
    problem_ = new QLabel(this);
    const auto add_label = [this](const QString& text) { addWidget(new QLabel("  " + text + " ", this)); };
    addWidget(name_);
    add_label(tr("event"));
    addWidget(ghost_event_);
    add_label(tr("aligned with"));
    addWidget(shown_event_);
    add_label(tr("Ghost offset"));
    addWidget(offset_);
    add_label("");
    addWidget(align_pelvis_);
    add_label("");
    addWidget(problem_);
    addAction(tr("Close ghost"), this, &GhostBar::closed);
    hide();
}

QComboBox* GhostBar::make_events() {
    auto* events = new QComboBox(this);
    const std::pair<QString, TrialEvent> names[] = {{tr("start"), TrialEvent::kBegin},
                                                    {tr("left foot down"), TrialEvent::kLeftFootDown},
                                                    {tr("right foot down"), TrialEvent::kRightFootDown},
                                                    {tr("highest point"), TrialEvent::kHighestPoint},
                                                    {tr("lowest point"), TrialEvent::kLowestPoint},
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

void GhostBar::show_problem(const std::string& lack) {
    problem_->setText(QString::fromStdString(lack));
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
bool GhostBar::align_pelvis() const {
    return align_pelvis_->isChecked();
}

}  // namespace kinevox::viewer
