// Guided calibration: choice of the procedure, instruction in large letters, coverage of each camera, and the
// stored calibrations with their certificates.
#pragma once

#include <QDialog>
#include <QPointer>
#include <QWidget>

#include "client/viewer/calibration.h"
#include "client/viewer/theme.h"

class QCheckBox;
class QComboBox;
class QDoubleSpinBox;
class QLabel;
class QLineEdit;
class QListWidget;
class QProgressBar;
class QPushButton;
class QStackedWidget;
class QTableWidget;
class QTextBrowser;

namespace kinevox::viewer {

QColor colour_of(v1::Verdict verdict, const Theme& theme);

// A calibration's certificate: verdict, findings, quality measures of each camera, and the page of images.
class CertificateView final : public QDialog {
    Q_OBJECT

  public:
    explicit CertificateView(QWidget* parent);
    // Raises the window, which is not modal.
    void show_certificate(const ShownCertificate& certificate);
    void set_theme(const Theme& theme);
    const ShownCertificate& shown() const { return shown_; }

  signals:
    void apply(const std::string& id);

  protected:
    void resizeEvent(QResizeEvent* event) override;

  private:
    QString html() const;
    void show_page();
    void save_page();

    ShownCertificate shown_;
    Theme theme_ = Theme::make(true);
    QLabel *verdict_ = nullptr, *sentence_ = nullptr, *page_ = nullptr;
    QTextBrowser* text_ = nullptr;
    QPushButton *apply_ = nullptr, *save_ = nullptr;
};

class CalibrationPanel final : public QWidget {
    Q_OBJECT

  public:
    explicit CalibrationPanel(QWidget* parent = nullptr);
    // Replaces the one of the previous daemon.
    void set_calibration(Calibration* calibration);
    void set_theme(const Theme& theme);
    CertificateView& certificate() { return *certificate_; }

  signals:
    void reported(const QString& message, bool ok);

  protected:
    void showEvent(QShowEvent* event) override;
    void hideEvent(QHideEvent* event) override;

  private:
    QWidget* make_choice();
    QWidget* make_guide();
    QWidget* make_stored();
    void show_choice();
    void show_progress();
    void show_cameras(const v1::WatchProcedureResponse& progress);
    void show_stored();
    void begin();
    void apply(const std::string& id);
    std::string chosen_id() const;

    QPointer<Calibration> calibration_;
    Theme theme_ = Theme::make(true);
    QStackedWidget* pages_ = nullptr;
    QComboBox *kind_ = nullptr, *board_ = nullptr;
    QLabel *purpose_ = nullptr, *board_label_ = nullptr, *wand_label_ = nullptr, *stature_label_ = nullptr;
    QLineEdit* wand_ = nullptr;
    QDoubleSpinBox* stature_ = nullptr;
    QCheckBox* board_on_floor_ = nullptr;
    QPushButton *begin_ = nullptr, *finish_ = nullptr, *cancel_ = nullptr;
    QLabel *instruction_ = nullptr, *hint_ = nullptr;
    QProgressBar* progress_ = nullptr;
    QTableWidget* cameras_ = nullptr;
    QListWidget* stored_ = nullptr;
    QPushButton *show_ = nullptr, *apply_ = nullptr, *undo_ = nullptr, *delete_ = nullptr;
    CertificateView* certificate_ = nullptr;
};

}  // namespace kinevox::viewer
