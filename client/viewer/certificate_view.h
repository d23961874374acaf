// A calibration's certificate: verdict, findings, quality measures of each camera, and the page of images.
#pragma once

#include <QDialog>

#include "client/viewer/calibration.h"
#include "client/viewer/theme.h"

class QLabel;
class QPushButton;
class QTextBrowser;

namespace kinevox::viewer {

QColor colour_of(v1::Verdict verdict, const Theme& theme);

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

}  // namespace kinevox::viewer
