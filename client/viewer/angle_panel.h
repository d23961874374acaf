// Chosen angles as large numbers and live curves, left and right in one plot with their ratio; of the
// selected subject and, dashed, of one that is compared with it.
#pragma once

#include <QWidget>
#include <string>
#include <vector>

#include "client/viewer/curves.h"
#include "client/viewer/subjects.h"
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

    // Marks are lines in the curves. The choice of subjects is visible while there are several.
    void show_history(const Subjects& subjects, const PlotMarks& marks);
    void set_theme(const Theme& theme);

    // Names as in angles.csv, for a pair the left one; kNumbers, then kCurves.
    std::vector<std::string> choices() const;
    // Ignored unless all names are known.
    void choose(const std::vector<std::string>& names);
    // Saves a curve with its marks and a legend of the sides, PNG or PDF by the file's extension; false on a
    // write error.
    bool save_plot(int curve, const QString& file) const;

  signals:
    void chosen();
    void subject_selected(quint32 id);
    void subject_compared(quint32 id);  // 0: none

  private:
    struct Number {
        QComboBox* choice;
        QLabel *left, *right, *compared;
    };
    struct Curve {
        QComboBox* choice;
        QCustomPlot* plot;
        QLabel* ratio;
    };
    QComboBox* make_choice();
    void offer(const std::vector<std::string>& names);
    void style(Curve& curve);
    QWidget* make_subject_row();
    void show_subjects(const Subjects& subjects);
    void show_number(Number& number, const Subjects& subjects);
    void show_curve(Curve& curve, const Subjects& subjects);
    void show_marks(Curve& curve, const Subjects& subjects, const PlotMarks& marks);

    QWidget* subject_row_;
    QComboBox *subject_ = nullptr, *compared_ = nullptr;
    std::vector<std::pair<std::uint32_t, std::string>> offered_subjects_;  // id, name
    std::vector<Number> numbers_;
    std::vector<Curve> curves_;
    std::vector<std::string> offered_, selected_;
    Theme theme_ = Theme::make(true);
};

}  // namespace kinevox::viewer
