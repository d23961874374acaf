#include "client/viewer/angle_panel.h"

#include <qcustomplot.h>

#include <QComboBox>
#include <QGridLayout>
#include <QLabel>
#include <QVBoxLayout>
#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>
#include <utility>

#include "common/body_table.h"

namespace kinevox::viewer {
namespace {

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
    auto* grid = new QGridLayout;
    for (int n = 0; n < kNumbers; ++n) {
        Number number{make_choice(), new LargeNumber(this), new LargeNumber(this)};
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
        curve.plot->addGraph();
        curve.plot->addGraph();
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

void AnglePanel::show_history(const AngleHistory& history, const PlotMarks& marks) {
    offer(history.names());
    for (Number& n : numbers_) {
        const std::string name = n.choice->currentData().toString().toStdString(),
                          other = AngleHistory::opposite_side(name);
        n.left->setText(number(history.latest_deg(name)));
        n.left->setStyleSheet("color: " + (other.empty() ? theme_.midline : theme_.left).name());
        n.right->setVisible(!other.empty());
        if (!other.empty()) n.right->setText(number(history.latest_deg(other)));
    }
    for (Curve& c : curves_) {
        show_curve(c, history);
        show_marks(c, history, marks);
        c.plot->replot(QCustomPlot::rpQueuedRefresh);
    }
}

void AnglePanel::show_curve(Curve& c, const AngleHistory& history) {
    const std::string name = c.choice->currentData().toString().toStdString(),
                      other = AngleHistory::opposite_side(name);
    double low = 1e9, high = -1e9;
    for (int side = 0; side < 2; ++side) {
        const AngleHistory::Series series = history.series(side == 0 ? name : other);
        QVector<double> t, v;
        for (std::size_t i = 0; i < series.time_s.size(); ++i) {
            if (series.time_s[i] < -kWindow_s) continue;
            t.push_back(series.time_s[i]);
            v.push_back(series.value_deg[i]);
            if (std::isnan(series.value_deg[i])) continue;
            low = std::min(low, series.value_deg[i]);
            high = std::max(high, series.value_deg[i]);
        }
        c.plot->graph(side)->setData(t, v, true);
    }
    if (low > high) low = -10, high = 90;
    const double centre = (low + high) / 2, half = std::max(kMinSpan_deg, 1.15 * (high - low)) / 2;
    c.plot->xAxis->setRange(-kWindow_s, 0);
    c.plot->yAxis->setRange(centre - half, centre + half);
    c.plot->graph(0)->setPen(QPen(other.empty() ? theme_.midline : theme_.left, 2));
    c.plot->graph(0)->setName(other.empty() ? label(name) : label(name) + tr(", left"));
    c.plot->graph(1)->setName(label(name) + tr(", right"));
    c.plot->graph(1)->setVisible(!other.empty());
    const auto ratio = history.left_over_right(name);
    c.ratio->setText(ratio ? tr("left / right  %1").arg(*ratio, 0, 'f', 2) : QString());
}

void AnglePanel::show_marks(Curve& c, const AngleHistory& history, const PlotMarks& marks) {
    c.plot->clearItems();
    const auto latest_ns = history.latest_time_ns();
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
        auto row = std::ranges::find_if(free_from_s, [&](double from_s) { return from_s <= at_s; });
        if (row == free_from_s.end()) row = std::ranges::min_element(free_from_s);
        *row = at_s + kMarkLabel_s;
        text->position->setCoords(at_s, kMarkRow * static_cast<double>(row - free_from_s.begin()));
        text->setPositionAlignment((at_s > -kMarkLabel_s ? Qt::AlignRight : Qt::AlignLeft) | Qt::AlignTop);
        text->setPadding(QMargins(3, 1, 3, 1));
        text->setText(QString::fromStdString(mark.text));
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
    c.plot->graph(0)->setPen(QPen(theme_.left, 2));
    c.plot->graph(1)->setPen(QPen(theme_.right, 2));
    c.plot->replot(QCustomPlot::rpQueuedRefresh);
}

void AnglePanel::set_theme(const Theme& theme) {
    theme_ = theme;
    for (Number& n : numbers_) n.right->setStyleSheet("color: " + theme.right.name());
    for (Curve& c : curves_) style(c);
}

bool AnglePanel::save_plot(int curve, const QString& file) const {
    QCustomPlot* plot = curves_.at(static_cast<std::size_t>(curve)).plot;
    plot->graph(1)->visible() ? plot->graph(1)->addToLegend() : plot->graph(1)->removeFromLegend();
    plot->legend->setVisible(true);  // on the screen, the colours of the numbers explain the sides
    const bool saved = file.endsWith(".pdf") ? plot->savePdf(file) : plot->savePng(file, 0, 0, 2);
    plot->legend->setVisible(false);
    return saved;
}

}  // namespace kinevox::viewer
