// Chosen angles as large numbers and as live curves, left and right in one plot with their ratio.
#pragma once

#include <QWidget>
#include <string>
#include <vector>

#include "client/viewer/angle_history.h"
#include "client/viewer/plot_marks.h"
#include "client/viewer/theme.h"

class QComboBox;
class QCustomPlot;
class QLabel;

namespace kinevox::viewer {

class AnglePanel final : public QWidget {
    Q_OBJECT

  public:
    static constexpr int kNumbers = 3, kCurves = 2;

    explicit AnglePanel(QWidget* parent = nullptr);

    // The history is read again; marks stand as lines in the curves.
    void show_history(const AngleHistory& history, const PlotMarks& marks);
    void set_theme(const Theme& theme);

    // Names as in angles.csv; for a pair the left one. kNumbers and then kCurves.
    std::vector<std::string> choices() const;
    void choose(const std::vector<std::string>& names);
    // A curve as it is, with its marks and which side is which, PNG or PDF by the name's ending; false where
    // that cannot be written.
    bool save_plot(int curve, const QString& file) const;

  signals:
    void chosen();

  private:
    struct Number {
        QComboBox* choice;
        QLabel *left, *right;
    };
    struct Curve {
        QComboBox* choice;
        QCustomPlot* plot;
        QLabel* ratio;
    };
    QComboBox* make_choice();
    void offer(const std::vector<std::string>& names);
    void style(Curve& curve);
    void show_curve(Curve& curve, const AngleHistory& history);
    void show_marks(Curve& curve, const AngleHistory& history, const PlotMarks& marks);

    std::vector<Number> numbers_;
    std::vector<Curve> curves_;
    std::vector<std::string> offered_, wanted_;
    Theme theme_ = Theme::make(true);
};

}  // namespace kinevox::viewer
