#include "client/viewer/calibration_panel.h"

#include <QCheckBox>
#include <QComboBox>
#include <QDateTime>
#include <QDoubleSpinBox>
#include <QFormLayout>
#include <QHBoxLayout>
#include <QHeaderView>
#include <QLabel>
#include <QLineEdit>
#include <QListWidget>
#include <QMessageBox>
#include <QProgressBar>
#include <QPushButton>
#include <QSettings>
#include <QStackedWidget>
#include <QTableWidget>
#include <algorithm>
#include <utility>

#include "client/viewer/calibration.h"
#include "common/proto_time.h"

namespace kinevox::viewer {
namespace {

// The instruction is read from within the space.
constexpr double kInstructionScale = 1.7;
constexpr int kMaxHints = 3;

QString text(const std::string& from) {
    return QString::fromStdString(from);
}

QLabel* wrapped(QWidget* parent) {
    auto* label = new QLabel(parent);
    label->setWordWrap(true);
    return label;
}

}  // namespace

CalibrationPanel::CalibrationPanel(QWidget* parent) : QWidget(parent) {
    pages_ = new QStackedWidget(this);
    pages_->addWidget(make_choice());
    pages_->addWidget(make_guide());
    auto* all = new QVBoxLayout(this);
    all->addWidget(pages_, 3);
    all->addWidget(make_stored(), 1);
    certificate_ = new CertificateView(this);
    connect(certificate_, &CertificateView::apply, this, &CalibrationPanel::apply);
    show_choice();
}

QWidget* CalibrationPanel::make_choice() {
    auto* page = new QWidget(this);
    const QSettings settings;
    kind_ = new QComboBox(page);
    kind_->setObjectName("calibration_kind");
    for (const CalibrationKindText& kind : calibration_kinds())
        kind_->addItem(tr(kind.name), static_cast<int>(kind.kind));
    kind_->setSizeAdjustPolicy(QComboBox::AdjustToMinimumContentsLengthWithIcon);
    kind_->setCurrentIndex(std::max(0, settings.value("calibration/kind", 0).toInt()));
    purpose_ = wrapped(page);
    board_ = new QComboBox(page);
    board_->setObjectName("calibration_board");
    board_->setEditable(true);
    board_->setSizeAdjustPolicy(QComboBox::AdjustToMinimumContentsLengthWithIcon);
    board_->addItems({"charuco:6x5:160:120:DICT_4X4_100", "checkerboard:4x7:60", "aprilgrid:6x6:88:26.4"});
    board_->setEditText(settings.value("calibration/board", board_->itemText(0)).toString());
    board_->setToolTip(
        tr("charuco:SQUARESxSQUARES:SQUARE mm:MARKER mm:DICTIONARY, checkerboard:CORNERSxCORNERS:mm (inner "
           "corners) or aprilgrid:TAGSxTAGS:TAG mm:GAP mm, as printed on the board"));
    wand_ = new QLineEdit(settings.value("calibration/wand", "wand:200:600").toString(), page);
    wand_->setToolTip(
        tr("Distances from the first ball to the second and third (mm); wand:600 has two balls"));
    stature_ = new QDoubleSpinBox(page);
    stature_->setRange(0.49, 2.6);
    stature_->setSingleStep(0.01);
    stature_->setSpecialValueText(tr("unknown"));
    stature_->setSuffix(" m");
    stature_->setValue(settings.value("calibration/stature_m", 0.49).toDouble());
    stature_->setToolTip(tr("Measured stature of the person with shoes; checks the scale"));
    board_on_floor_ =
        new QCheckBox(tr("First capture the board on the floor to define floor and origin"), page);
    board_on_floor_->setChecked(settings.value("calibration/board_on_floor", false).toBool());
    begin_ = new QPushButton(tr("Start"), page);
    begin_->setObjectName("calibration_begin");
    begin_->setDefault(true);
    connect(begin_, &QPushButton::clicked, this, &CalibrationPanel::begin);
    connect(kind_, &QComboBox::currentIndexChanged, this, &CalibrationPanel::show_choice);

    auto* form = new QFormLayout(page);
    form->setContentsMargins(0, 0, 0, 0);
    form->setRowWrapPolicy(QFormLayout::WrapLongRows);
    form->addRow(kind_);
    form->addRow(purpose_);
    form->addRow(board_label_ = new QLabel(tr("Board"), page), board_);
    form->addRow(wand_label_ = new QLabel(tr("Wand"), page), wand_);
    form->addRow(stature_label_ = new QLabel(tr("Stature"), page), stature_);
    form->addRow(board_on_floor_);
    form->addRow(begin_);
    return page;
}

QWidget* CalibrationPanel::make_guide() {
    auto* page = new QWidget(this);
    instruction_ = wrapped(page);
    instruction_->setObjectName("calibration_instruction");
    QFont font = instruction_->font();
    font.setPointSizeF(kInstructionScale * font.pointSizeF());
    font.setBold(true);
    instruction_->setFont(font);
    hint_ = wrapped(page);
    hint_->setObjectName("calibration_hint");
    hint_->setAlignment(Qt::AlignTop | Qt::AlignLeft);
    progress_ = new QProgressBar(page);
    progress_->setRange(0, 1000);
    progress_->setFormat("%p %");
    cameras_ = new QTableWidget(0, 3, page);
    cameras_->setHorizontalHeaderLabels({tr("Camera"), tr("Views"), tr("Coverage")});
    cameras_->verticalHeader()->hide();
    cameras_->horizontalHeader()->setSectionResizeMode(QHeaderView::Stretch);
    cameras_->setEditTriggers(QAbstractItemView::NoEditTriggers);
    cameras_->setSelectionMode(QAbstractItemView::NoSelection);
    cameras_->setFocusPolicy(Qt::NoFocus);
    cameras_->verticalHeader()->setDefaultSectionSize(cameras_->fontMetrics().height() + 6);
    finish_ = new QPushButton(page);
    finish_->setObjectName("calibration_finish");
    cancel_ = new QPushButton(tr("Cancel"), page);
    cancel_->setObjectName("calibration_cancel");
    connect(finish_, &QPushButton::clicked, this, [this] {
        if (calibration_) calibration_->finish_step();
    });
    connect(cancel_, &QPushButton::clicked, this, [this] {
        if (calibration_) calibration_->cancel();
    });
    auto* buttons = new QHBoxLayout;
    buttons->addWidget(finish_, 1);
    buttons->addWidget(cancel_);
    auto* all = new QVBoxLayout(page);
    all->setContentsMargins(0, 0, 0, 0);
    all->addWidget(instruction_);
    all->addWidget(hint_);
    all->addWidget(progress_);
    all->addWidget(cameras_, 1);
    all->addLayout(buttons);
    return page;
}

QWidget* CalibrationPanel::make_stored() {
    auto* widget = new QWidget(this);
    stored_ = new QListWidget(widget);
    stored_->setObjectName("calibrations");
    show_ = new QPushButton(tr("Certificate"), widget);
    show_->setObjectName("calibration_show");
    apply_ = new QPushButton(tr("Apply"), widget);
    apply_->setObjectName("calibration_apply");
    undo_ = new QPushButton(tr("Undo"), widget);
    undo_->setObjectName("calibration_undo");
    undo_->setToolTip(tr("Revert to the previous calibration"));
    delete_ = new QPushButton(tr("Delete"), widget);
    delete_->setObjectName("calibration_delete");
    const auto show = [this] {
        if (calibration_ && !chosen_id().empty()) calibration_->show_certificate(chosen_id());
    };
    connect(show_, &QPushButton::clicked, this, show);
    connect(stored_, &QListWidget::itemActivated, this, show);
    connect(stored_, &QListWidget::currentRowChanged, this, [this] {
        for (QPushButton* button : {show_, apply_, delete_}) button->setEnabled(!chosen_id().empty());
    });
    connect(apply_, &QPushButton::clicked, this, [this] { apply(chosen_id()); });
    connect(undo_, &QPushButton::clicked, this, [this] {
        if (calibration_) calibration_->undo();
    });
    connect(delete_, &QPushButton::clicked, this, [this] {
        if (calibration_ && !chosen_id().empty()) calibration_->delete_calibration(chosen_id());
    });
    auto* buttons = new QHBoxLayout;
    for (QPushButton* button : {show_, apply_, undo_, delete_}) {
        button->setEnabled(false);
        buttons->addWidget(button);
    }
    auto* all = new QVBoxLayout(widget);
    all->setContentsMargins(0, 0, 0, 0);
    all->addWidget(new QLabel(tr("Stored calibrations"), widget));
    all->addWidget(stored_, 1);
    all->addLayout(buttons);
    return widget;
}

void CalibrationPanel::set_calibration(Calibration* calibration) {
    calibration_ = calibration;
    stored_->clear();
    certificate_->hide();
    connect(calibration, &Calibration::progress_received, this, &CalibrationPanel::show_progress);
    connect(calibration, &Calibration::stored_received, this, &CalibrationPanel::show_stored);
    connect(calibration, &Calibration::certificate_received, this,
            [this] { certificate_->show_certificate(calibration_->certificate()); });
    connect(calibration, &Calibration::solved, this, [this](const QString& id) {
        emit reported(tr("calibration %1 stored").arg(id), true);
        calibration_->list();
        calibration_->show_certificate(id.toStdString());
    });
    connect(calibration, &Calibration::done, this,
            [this](const QString& message) { emit reported(message, true); });
    connect(calibration, &Calibration::failed, this,
            [this](const QString& message) { emit reported(message, false); });
    if (isVisible()) {
        calibration->watch(true);
        calibration->list();
    }
    show_progress();
}

void CalibrationPanel::showEvent(QShowEvent*) {
    if (!calibration_) return;
    calibration_->watch(true);
    calibration_->list();
}

void CalibrationPanel::hideEvent(QHideEvent*) {
    if (calibration_) calibration_->watch(false);  // this window's procedure is watched by its own thread
}

void CalibrationPanel::set_theme(const Theme& theme) {
    theme_ = theme;
    instruction_->setStyleSheet("color: " + theme.text.name());
    hint_->setStyleSheet("color: " + theme.warning.name());
    certificate_->set_theme(theme);
    if (calibration_) show_stored();
}

void CalibrationPanel::show_choice() {
    const auto kind = static_cast<v1::ProcedureKind>(kind_->currentData().toInt());
    const bool board = kind == v1::PROCEDURE_KIND_INTRINSICS || kind == v1::PROCEDURE_KIND_EXTRINSICS_BOARD;
    const bool wand = kind == v1::PROCEDURE_KIND_EXTRINSICS_WAND,
               person = kind == v1::PROCEDURE_KIND_EXTRINSICS_REFINE_PERSON;
    purpose_->setText(tr(calibration_kinds()[static_cast<std::size_t>(kind_->currentIndex())].purpose));
    for (QWidget* w : {static_cast<QWidget*>(board_label_), static_cast<QWidget*>(board_)})
        w->setVisible(board);
    for (QWidget* w : {static_cast<QWidget*>(wand_label_), static_cast<QWidget*>(wand_)}) w->setVisible(wand);
    for (QWidget* w : {static_cast<QWidget*>(stature_label_), static_cast<QWidget*>(stature_)})
        w->setVisible(person);
    board_on_floor_->setVisible(kind == v1::PROCEDURE_KIND_EXTRINSICS_BOARD);
}

void CalibrationPanel::begin() {
    if (!calibration_) return;
    QSettings settings;
    settings.setValue("calibration/kind", kind_->currentIndex());
    settings.setValue("calibration/board", board_->currentText());
    settings.setValue("calibration/wand", wand_->text());
    settings.setValue("calibration/stature_m", stature_->value());
    settings.setValue("calibration/board_on_floor", board_on_floor_->isChecked());
    client::CalibrationPlan plan;
    plan.procedure.set_kind(static_cast<v1::ProcedureKind>(kind_->currentData().toInt()));
    plan.procedure.set_board(board_->currentText().trimmed().toStdString());
    plan.procedure.set_wand(wand_->text().trimmed().toStdString());
    if (stature_->value() > stature_->minimum()) plan.procedure.set_stature_m(stature_->value());
    plan.board_on_floor =
        plan.procedure.kind() == v1::PROCEDURE_KIND_EXTRINSICS_BOARD && board_on_floor_->isChecked();
    if (!calibration_->begin(plan)) emit reported(tr("a calibration is already running"), false);
}

void CalibrationPanel::show_progress() {
    if (!calibration_) return;
    const v1::WatchProcedureResponse progress = calibration_->progress();
    const bool own = calibration_->running();
    const CalibrationStep step = own ? calibration_->step() : step_of(progress);
    pages_->setCurrentIndex(step == CalibrationStep::kNone ? 0 : 1);
    if (step == CalibrationStep::kNone) return;
    instruction_->setText(text(instruction(progress.kind(), step)));
    const bool solving = step == CalibrationStep::kSolving || step == CalibrationStep::kReadingFiles;
    QStringList hints;
    if (!calibration_->insufficient_reason().empty()) hints << text(calibration_->insufficient_reason());
    if (!own) hints << tr("Another client is calibrating.");
    for (const std::string& hint : progress.hints())
        if (!solving && hints.size() < kMaxHints && !hints.contains(text(hint))) hints << text(hint);
    if (solving || hints.isEmpty()) hints = QStringList(text(progress.message()));
    hint_->setText(hints.join("\n\n"));
    // A layout does not know the height of a label with wrapped lines.
    for (QLabel* label : {instruction_, hint_})
        label->setMinimumHeight(std::max(0, label->heightForWidth(label->width())));
    progress_->setVisible(solving);
    progress_->setValue(static_cast<int>(1000 * progress.progress()));
    finish_->setVisible(own && !solving);
    finish_->setEnabled(step == CalibrationStep::kMovingTarget || step == CalibrationStep::kBoardOnFloor);
    finish_->setText(step == CalibrationStep::kBoardOnFloor ? tr("Skip the floor") : tr("Finish"));
    show_cameras(progress);
}

void CalibrationPanel::show_cameras(const v1::WatchProcedureResponse& progress) {
    cameras_->setRowCount(progress.cameras_size());
    for (int row = 0; row < progress.cameras_size(); ++row) {
        const v1::CameraObservations& camera = progress.cameras(row);
        const QString cells[] = {text(camera.name()), QString::number(camera.accepted_count()),
                                 QString("%1 %").arg(qRound(100 * camera.coverage()))};
        for (int column = 0; column < 3; ++column) {
            QTableWidgetItem* item = cameras_->item(row, column);
            if (!item) cameras_->setItem(row, column, item = new QTableWidgetItem);
            item->setText(cells[column]);
            item->setForeground(camera.detected_in_latest() ? theme_.good : theme_.text);
            item->setToolTip(text(camera.latest_rejection_reason()));
        }
    }
}

void CalibrationPanel::show_stored() {
    const v1::ListCalibrationsResponse stored = calibration_->stored();
    const std::string chosen = chosen_id();
    stored_->clear();
    for (int n = stored.calibrations_size() - 1; n >= 0; --n) {
        const v1::Calibration& entry = stored.calibrations(n);
        const QString when = QDateTime::fromMSecsSinceEpoch(to_utc_ns(entry.create_time()) / 1'000'000)
                                 .toString("d MMM  hh:mm");
        const bool pending = entry.id() == stored.pending_id() && !entry.active();
        QString line = QString("%1   %2   %3   %4")
                           .arg(text(entry.id()), when, text(verdict_text(entry.verdict())),
                                text(client::method_text(entry.method())));
        if (entry.active()) line += tr("   active");
        if (pending) line += tr("   from the next start");
        if (!entry.compatible()) line += tr("   for other cameras");
        if (!entry.note().empty()) line += "   " + text(entry.note());
        auto* item = new QListWidgetItem(line, stored_);
        item->setData(Qt::UserRole, text(entry.id()));
        item->setForeground(colour_of(entry.verdict(), theme_));
        if (entry.id() == chosen || (chosen.empty() && entry.active())) stored_->setCurrentItem(item);
    }
    undo_->setEnabled(stored.can_undo());
}

std::string CalibrationPanel::chosen_id() const {
    const QListWidgetItem* item = stored_->currentItem();
    return item ? item->data(Qt::UserRole).toString().toStdString() : std::string();
}

// Asks before it forces what the daemon would refuse.
void CalibrationPanel::apply(const std::string& id) {
    if (!calibration_ || id.empty()) return;
    const v1::ListCalibrationsResponse stored = calibration_->stored();
    const auto entry = std::ranges::find(stored.calibrations(), id, &v1::Calibration::id);
    const bool no_go = entry != stored.calibrations().end() && entry->verdict() == v1::VERDICT_NO_GO;
    if (no_go &&
        QMessageBox::question(
            this, tr("Apply anyway?"),
            tr("Calibration %1 is NO-GO: measurements with it are wrong. Apply anyway?").arg(text(id))) !=
            QMessageBox::Yes)
        return;
    if (!calibration_->apply(id, no_go)) emit reported(tr("too many pending commands; try again"), false);
}

}  // namespace kinevox::viewer
