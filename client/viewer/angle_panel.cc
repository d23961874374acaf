#include "client/viewer/angle_panel.h"

#include <qcustomplot.h>

#include <QAbstractItemView>
#include <QComboBox>
#include <QGridLayout>
#include <QLabel>
#include <QPixmap>
#include <QVBoxLayout>
#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <utility>

#include "common/body_table.h"

namespace kinevox::viewer {
namespace {

constexpr int kGraphs = 4;  // left and right, then of the compared subject
constexpr int kNumberHeight_pt = 30, kDefaultNumberHeight_pt = 15, kMinNumberHeight_pt = 10;
constexpr double kMinSpan_deg = 20, kWindow_s = 6;
// Labels of marks: their width and height; in rows so that they do not overlap.
constexpr double kMarkLabel_s = 1.6, kMarkRow = 0.14;
constexpr std::size_t kMarkRows = 4;
const std::vector<std::string> kDefaultChoice{"knee_flexion_geometric_l", "hip_flexion_geometric_l",
                                              "trunk_lean_geometric", "knee_flexion_geometric_l",
                                              "hip_flexion_geometric_l"};

// The label of the body table; the name itself for an angle that it lacks.
QString label(const std::string& angle) {
    const auto found = std::ranges::find(kJointAngleNames, angle);
    if (found == kJointAngleNames.end()) return QString::fromStdString(angle);
    const std::string_view text =
        kJointAngleLabels[static_cast<std::size_t>(found - kJointAngleNames.begin())];
    return QString::fromUtf8(text.data(), static_cast<qsizetype>(text.size()));
}

QString number(const std::optional<double>& value_deg) {
    return value_deg ? QString::number(std::lround(*value_deg)) + QChar(0x00b0) : QStringLiteral("–");
}

// The font is as large as the widest number allows; it does not change with the number.
class LargeNumber final : public QLabel {
  public:
    explicit LargeNumber(QWidget* parent) : QLabel(parent) {
        setAlignment(Qt::AlignCenter);
        setFixedHeight(QFontMetrics(font_of(kNumberHeight_pt)).height());
    }
    QSize sizeHint() const override { return {width_in(kDefaultNumberHeight_pt), height()}; }
    QSize minimumSizeHint() const override { return {width_in(kMinNumberHeight_pt), height()}; }

  protected:
    void resizeEvent(QResizeEvent* event) override {
        const int fitting = kNumberHeight_pt * width() / width_in(kNumberHeight_pt);
        setFont(font_of(std::clamp(fitting, kMinNumberHeight_pt, kNumberHeight_pt)));
        QLabel::resizeEvent(event);
    }

  private:
    QFont font_of(int height_pt) const {
        QFont font = this->font();
        font.setPointSize(height_pt);
        font.setBold(true);
        return font;
    }
    int width_in(int height_pt) const {
        return QFontMetrics(font_of(height_pt)).horizontalAdvance(number(-188)) + 4;
    }
};

}  // namespace

AnglePanel::AnglePanel(QWidget* parent) : QWidget(parent), selected_(kDefaultChoice) {
    auto* all = new QVBoxLayout(this);
    subject_row_ = make_subject_row();
    all->addWidget(subject_row_);
    auto* grid = new QGridLayout;
    for (int n = 0; n < kNumbers; ++n) {
        Number number{make_choice(), new LargeNumber(this), new LargeNumber(this), new QLabel(this)};
        number.choice->setSizeAdjustPolicy(QComboBox::AdjustToMinimumContentsLengthWithIcon);
        number.choice->setMinimumContentsLength(6);
        number.choice->setSizePolicy(QSizePolicy::Expanding, QSizePolicy::Fixed);
        number.choice->setToolTip(tr("Angle shown as a number"));
        grid->setColumnStretch(n, 1);
        number.left->setToolTip(tr("left"));
        number.right->setToolTip(tr("right"));
        grid->addWidget(number.choice, 0, n);
        auto* pair = new QHBoxLayout;
        pair->addWidget(number.left);
        pair->addWidget(number.right);
        grid->addLayout(pair, 1, n);
        number.compared->setAlignment(Qt::AlignCenter);
        number.compared->hide();
        grid->addWidget(number.compared, 2, n);
        numbers_.push_back(number);
    }
    all->addLayout(grid);
    for (int n = 0; n < kCurves; ++n) {
        Curve curve{make_choice(), new QCustomPlot(this), new QLabel(this)};
        auto* row = new QHBoxLayout;
        row->addWidget(curve.choice);
        row->addStretch();
        row->addWidget(curve.ratio);
        all->addLayout(row);
        curve.plot->setMinimumHeight(110);
        for (int graph = 0; graph < kGraphs; ++graph) curve.plot->addGraph();
        curve.plot->setAntialiasedElements(QCP::aeNone);
        curve.plot->setNotAntialiasedElements(QCP::aeAll);  // halves the cost of a live curve
        curve.plot->xAxis->setNumberFormat("f");
        curve.plot->xAxis->setNumberPrecision(0);
        curve.plot->xAxis->setLabel(tr("seconds before now"));
        curve.plot->yAxis->setLabel(tr("degrees"));
        all->addWidget(curve.plot, 1);
        curves_.push_back(curve);
    }
    offer({});
    set_theme(theme_);
}

QWidget* AnglePanel::make_subject_row() {
    auto* row = new QWidget(this);
    auto* line = new QHBoxLayout(row);
    line->setContentsMargins(0, 0, 0, 0);
    subject_ = new QComboBox(row);
    subject_->setObjectName("subject");
    subject_->setToolTip(tr("Subject whose angles are shown; or click it in the scene, or press A"));
    compared_ = new QComboBox(row);
    compared_->setObjectName("compared_subject");
    compared_->setToolTip(tr("Subject whose curves are dashed"));
    line->addWidget(subject_, 1);
    line->addWidget(new QLabel(tr("compared with"), row));
    line->addWidget(compared_, 1);
    row->hide();
    connect(subject_, &QComboBox::activated, this,
            [this] { emit subject_selected(subject_->currentData().toUInt()); });
    connect(compared_, &QComboBox::activated, this,
            [this] { emit subject_compared(compared_->currentData().toUInt()); });
    return row;
}

void AnglePanel::show_subjects(const Subjects& subjects) {
    subject_row_->setVisible(subjects.several());
    std::vector<std::pair<std::uint32_t, std::string>> offered;
    if (subjects.several())
        for (const std::uint32_t id : subjects.ids()) offered.emplace_back(id, subjects.name_of(id));
    if (offered != offered_subjects_) {
        offered_subjects_ = offered;
        subject_->clear();
        compared_->clear();
        compared_->addItem(tr("no one"), 0U);
        for (const auto& [id, name] : offered) {
            QPixmap icon(16, 16);
            icon.fill(theme_.subject(subjects.colours().at(id)));
            const QString text = name.empty() ? tr("Subject %1").arg(id)
                                              : QString::fromStdString(name) + QString(" (%1)").arg(id);
            for (QComboBox* box : {subject_, compared_}) box->addItem(icon, text, id);
        }
    }
    if (!subject_->view()->isVisible()) subject_->setCurrentIndex(subject_->findData(subjects.selected()));
    if (!compared_->view()->isVisible())
        compared_->setCurrentIndex(compared_->findData(subjects.compared().value_or(0)));
}

QComboBox* AnglePanel::make_choice() {
    auto* choice = new QComboBox(this);
    choice->setSizeAdjustPolicy(QComboBox::AdjustToContents);
    connect(choice, &QComboBox::activated, this, [this] {
        selected_ = choices();
        emit chosen();
    });
    return choice;
}

// One entry per pair of sides. The selection stays, even if the daemon does not send that angle.
void AnglePanel::offer(const std::vector<std::string>& names) {
    std::vector<std::string> entries;
    for (const std::string& name : names)
        if (!name.ends_with("_r")) entries.push_back(name);
    for (const std::string& name : selected_)
        if (!std::ranges::count(entries, name)) entries.push_back(name);
    if (entries == offered_) return;
    offered_ = entries;
    std::vector<QComboBox*> boxes;
    for (const Number& n : numbers_) boxes.push_back(n.choice);
    for (const Curve& c : curves_) boxes.push_back(c.choice);
    for (std::size_t n = 0; n < boxes.size(); ++n) {
        boxes[n]->clear();
        for (const std::string& name : entries) boxes[n]->addItem(label(name), QString::fromStdString(name));
        boxes[n]->setCurrentIndex(boxes[n]->findData(QString::fromStdString(selected_[n])));
    }
}

std::vector<std::string> AnglePanel::choices() const {
    std::vector<std::string> names;
    for (const Number& n : numbers_) names.push_back(n.choice->currentData().toString().toStdString());
    for (const Curve& c : curves_) names.push_back(c.choice->currentData().toString().toStdString());
    return names;
}

void AnglePanel::choose(const std::vector<std::string>& names) {
    const auto known = [](const std::string& name) { return std::ranges::count(kJointAngleNames, name) > 0; };
    if (names.size() != static_cast<std::size_t>(kNumbers + kCurves) || !std::ranges::all_of(names, known))
        return;
    selected_ = names;
    const std::vector<std::string> offered = std::exchange(offered_, {});
    offer(offered);
}

void AnglePanel::show_history(const Subjects& subjects, const PlotMarks& marks) {
    show_subjects(subjects);
    offer(subjects.history().names());
    for (Number& n : numbers_) show_number(n, subjects);
    for (Curve& c : curves_) {
        show_curve(c, subjects);
        show_marks(c, subjects, marks);
        c.plot->replot(QCustomPlot::rpQueuedRefresh);
    }
}

void AnglePanel::show_number(Number& n, const Subjects& subjects) {
    const AngleHistory& history = subjects.history();
    const std::string name = n.choice->currentData().toString().toStdString(),
                      other = AngleHistory::opposite_side(name);
    n.left->setText(number(history.latest_deg(name)));
    n.left->setStyleSheet("color: " + (other.empty() ? theme_.midline : theme_.left).name());
    n.right->setVisible(!other.empty());
    if (!other.empty()) n.right->setText(number(history.latest_deg(other)));
    const auto compared = subjects.compared();
    n.compared->setVisible(compared.has_value());
    if (!compared) return;
    const AngleHistory& theirs = subjects.history(*compared);
    n.compared->setStyleSheet("color: " + theme_.subject(subjects.colours().at(*compared)).name());
    n.compared->setText(number(theirs.latest_deg(name)) +
                        (other.empty() ? QString() : "  " + number(theirs.latest_deg(other))));
}

void AnglePanel::show_curve(Curve& c, const Subjects& subjects) {
    const std::string name = c.choice->currentData().toString().toStdString(),
                      other = AngleHistory::opposite_side(name);
    const auto compared = subjects.compared();
    double low = 1e9, high = -1e9;
    for (int graph = 0; graph < kGraphs; ++graph) {
        const bool is_left = graph % 2 == 0, is_compared = graph >= 2;
        c.plot->graph(graph)->setVisible((is_left || !other.empty()) && (!is_compared || compared));
        QVector<double> t, v;
        if (c.plot->graph(graph)->visible()) {
            const AngleHistory& history = is_compared ? subjects.history(*compared) : subjects.history();
            const AngleHistory::Series series = history.series(is_left ? name : other);
            for (std::size_t i = 0; i < series.time_s.size(); ++i) {
                if (series.time_s[i] < -kWindow_s) continue;
                t.push_back(series.time_s[i]);
                v.push_back(series.value_deg[i]);
                if (std::isnan(series.value_deg[i])) continue;
                low = std::min(low, series.value_deg[i]);
                high = std::max(high, series.value_deg[i]);
            }
        }
        c.plot->graph(graph)->setData(t, v, true);
        const QColor& colour = is_left ? other.empty() ? theme_.midline : theme_.left : theme_.right;
        c.plot->graph(graph)->setPen(
            QPen(colour, is_compared ? 1.5 : 2, is_compared ? Qt::DashLine : Qt::SolidLine));
        const QString side = other.empty() ? QString() : is_left ? tr(", left") : tr(", right");
        const std::uint32_t id = is_compared ? compared.value_or(0) : subjects.selected();
        const std::string subject_name = subjects.name_of(id);
        const QString subject =
            subject_name.empty() ? tr(", subject %1").arg(id) : ", " + QString::fromStdString(subject_name);
        c.plot->graph(graph)->setName(label(name) + side + (subjects.several() ? subject : QString()));
    }
    if (low > high) low = -10, high = 90;
    const double centre = (low + high) / 2, half = std::max(kMinSpan_deg, 1.15 * (high - low)) / 2;
    c.plot->xAxis->setRange(-kWindow_s, 0);
    c.plot->yAxis->setRange(centre - half, centre + half);
    const auto ratio = subjects.history().left_over_right(name);
    c.ratio->setText(ratio ? tr("left / right  %1").arg(*ratio, 0, 'f', 2) : QString());
}

void AnglePanel::show_marks(Curve& c, const Subjects& subjects, const PlotMarks& marks) {
    c.plot->clearItems();
    const auto latest_ns = subjects.history().latest_time_ns();
    if (!latest_ns) return;
    std::array<double, kMarkRows> free_from_s;  // of each row of texts
    free_from_s.fill(-2 * kWindow_s);
    for (const PlotMark& mark :
         marks.between(*latest_ns - static_cast<std::int64_t>(1e9 * kWindow_s), *latest_ns)) {
        const double at_s = 1e-9 * static_cast<double>(mark.time_ns - *latest_ns);
        const QColor& colour = mark.by_user ? theme_.good : theme_.faint;
        auto* line = new QCPItemStraightLine(c.plot);  // the plot owns its items
        line->point1->setCoords(at_s, 0);
        line->point2->setCoords(at_s, 1);
        line->setPen(QPen(colour, 1, Qt::DashLine));
        auto* text = new QCPItemText(c.plot);
        text->position->setTypeX(QCPItemPosition::ptPlotCoords);
        text->position->setTypeY(QCPItemPosition::ptAxisRectRatio);
        const bool before_line = at_s > -kMarkLabel_s;
        const double label_from_s = before_line ? at_s - kMarkLabel_s : at_s;
        auto row = std::ranges::find_if(free_from_s, [&](double from_s) { return from_s <= label_from_s; });
        if (row == free_from_s.end()) row = std::ranges::min_element(free_from_s);
        *row = label_from_s + kMarkLabel_s;
        text->position->setCoords(at_s, kMarkRow * static_cast<double>(row - free_from_s.begin()));
        text->setPositionAlignment((before_line ? Qt::AlignRight : Qt::AlignLeft) | Qt::AlignTop);
        text->setPadding(QMargins(3, 1, 3, 1));
        const bool of_one = subjects.several() && mark.subject_id != 0;
        text->setText(QString::fromStdString(mark.text) +
                      (of_one ? QString(" %1").arg(mark.subject_id) : QString()));
        text->setColor(colour);
    }
}

void AnglePanel::style(Curve& c) {
    c.plot->setBackground(theme_.background);
    for (QCPAxis* axis : {c.plot->xAxis, c.plot->yAxis}) {
        axis->setBasePen(QPen(theme_.faint));
        axis->setTickPen(QPen(theme_.faint));
        axis->setSubTickPen(Qt::NoPen);
        axis->setTickLabelColor(theme_.text);
        axis->setLabelColor(theme_.faint);
        axis->grid()->setPen(QPen(theme_.floor_lines));
        axis->grid()->setZeroLinePen(QPen(theme_.floor_axis));
    }
    c.plot->legend->setBrush(theme_.background);
    c.plot->legend->setBorderPen(QPen(theme_.faint));
    c.plot->legend->setTextColor(theme_.text);
    for (int graph = 0; graph < kGraphs; ++graph)
        c.plot->graph(graph)->setPen(QPen(graph % 2 == 0 ? theme_.left : theme_.right, 2));
    c.plot->replot(QCustomPlot::rpQueuedRefresh);
}

void AnglePanel::set_theme(const Theme& theme) {
    theme_ = theme;
    for (Number& n : numbers_) n.right->setStyleSheet("color: " + theme.right.name());
    for (Curve& c : curves_) style(c);
    offered_subjects_.clear();  // so that the icons are made again
}

bool AnglePanel::save_plot(int curve, const QString& file) const {
    QCustomPlot* plot = curves_.at(static_cast<std::size_t>(curve)).plot;
    for (int graph = 1; graph < kGraphs; ++graph)
        plot->graph(graph)->visible() ? plot->graph(graph)->addToLegend()
                                      : plot->graph(graph)->removeFromLegend();
    plot->legend->setVisible(true);  // on the screen, the colours of the numbers explain the sides
    // Of two subjects, the legend needs as much space as the curves.
    const bool two = plot->graph(kGraphs / 2)->visible();
    plot->axisRect()->insetLayout()->setInsetAlignment(
        0, two ? Qt::AlignLeft | Qt::AlignTop : Qt::AlignRight | Qt::AlignTop);
    const double centre = plot->yAxis->range().center(), span = plot->yAxis->range().size();
    if (two) plot->yAxis->setRange(centre - span / 2, centre + 1.5 * span);
    const int width = two ? plot->width() : 0, height = two ? 2 * plot->height() : 0;  // 0: as on the screen
    const bool saved =
        file.endsWith(".pdf") ? plot->savePdf(file, width, height) : plot->savePng(file, width, height, 2);
    plot->yAxis->setRange(centre - span / 2, centre + span / 2);
    plot->legend->setVisible(false);
    return saved;
}

}  // namespace kinevox::viewer
