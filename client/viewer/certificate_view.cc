#include <QDialogButtonBox>
#include <QFileDialog>
#include <QHBoxLayout>
#include <QLabel>
#include <QMessageBox>
#include <QPushButton>
#include <QScrollArea>
#include <QTextBrowser>

#include "client/viewer/calibration.h"
#include "client/viewer/calibration_panel.h"

namespace kinevox::viewer {
namespace {

constexpr double kVerdictScale = 2.6;

QString escaped(const std::string& text) {
    return QString::fromStdString(text).toHtmlEscaped();
}

QString pixels(bool has, double value) {
    return has ? QString::number(value, 'f', 2) : QStringLiteral("–");
}

QString percent(bool has, double value) {
    return has ? QString("%1 %").arg(qRound(100 * value)) : QStringLiteral("–");
}

QString iou(bool has, double value) {
    return has ? QString::number(value, 'f', 3) : QStringLiteral("–");
}

QString camera_table(const v1::Certificate& certificate) {
    QString rows = "<tr><th align='left'>" + QObject::tr("camera") + "</th>";
    for (const QString& head :
         {QObject::tr("views"), QObject::tr("reprojection error, px"), QObject::tr("held-out error, px"),
          QObject::tr("coverage"), QObject::tr("hull IoU")})
        rows += "<th align='right'>&nbsp;&nbsp;" + head + "</th>";
    rows += "</tr>";
    for (const v1::CameraCertificate& c : certificate.cameras()) {
        rows += "<tr><td>" + escaped(c.name()) + "</td>";
        for (const QString& cell :
             {c.view_count() > 0 ? QString::number(c.view_count()) : QStringLiteral("–"),
              c.has_intrinsics_rms_px()
                  ? pixels(true, c.intrinsics_rms_px())
                  : pixels(c.has_fit_reprojection_rms_px(), c.fit_reprojection_rms_px()),
              pixels(c.has_held_out_reprojection_rms_px(), c.held_out_reprojection_rms_px()),
              percent(c.has_coverage(), c.coverage()), iou(c.has_hull_iou(), c.hull_iou())})
            rows += "<td align='right'>&nbsp;&nbsp;" + cell + "</td>";
        rows += "</tr>";
    }
    return "<table cellpadding='2'>" + rows + "</table>";
}

}  // namespace

QColor colour_of(v1::Verdict verdict, const Theme& theme) {
    switch (verdict) {
        case v1::VERDICT_GO:
            return theme.good;
        case v1::VERDICT_CAUTION:
            return theme.warning;
        case v1::VERDICT_NO_GO:
            return theme.error;
        default:
            return theme.faint;
    }
}

CertificateView::CertificateView(QWidget* parent) : QDialog(parent) {
    setObjectName("certificate");
    resize(1000, 640);
    verdict_ = new QLabel(this);
    QFont font = verdict_->font();
    font.setPointSizeF(kVerdictScale * font.pointSizeF());
    font.setBold(true);
    verdict_->setFont(font);
    sentence_ = new QLabel(this);
    sentence_->setWordWrap(true);
    text_ = new QTextBrowser(this);
    page_ = new QLabel(this);
    page_->setAlignment(Qt::AlignCenter);
    page_->setMinimumSize(320, 320);
    page_->setSizePolicy(QSizePolicy::Ignored, QSizePolicy::Ignored);
    auto* buttons = new QDialogButtonBox(QDialogButtonBox::Close, this);
    apply_ = buttons->addButton(tr("Apply"), QDialogButtonBox::ActionRole);
    save_ = buttons->addButton(tr("Save page..."), QDialogButtonBox::ActionRole);
    for (QPushButton* button : {apply_, save_}) button->setAutoDefault(false);
    connect(buttons, &QDialogButtonBox::rejected, this, &QDialog::hide);
    connect(apply_, &QPushButton::clicked, this, [this] {
        hide();
        emit apply(shown_.id);
    });
    connect(save_, &QPushButton::clicked, this, &CertificateView::save_page);

    auto* top = new QHBoxLayout;
    top->addWidget(verdict_);
    top->addWidget(sentence_, 1);
    auto* contents = new QHBoxLayout;
    contents->addWidget(text_, 1);
    contents->addWidget(page_, 1);
    auto* all = new QVBoxLayout(this);
    all->addLayout(top);
    all->addLayout(contents, 1);
    all->addWidget(buttons);
}

void CertificateView::show_certificate(const ShownCertificate& certificate) {
    shown_ = certificate;
    const v1::Verdict verdict = shown_.certificate.verdict();
    setWindowTitle(tr("Calibration %1").arg(QString::fromStdString(shown_.id)));
    verdict_->setText(QString::fromStdString(verdict_text(verdict)));
    verdict_->setStyleSheet("color: " + colour_of(verdict, theme_).name());
    sentence_->setText(QString::fromStdString(verdict_sentence(verdict)));
    text_->setHtml(html());
    save_->setEnabled(!shown_.page.isNull());
    show_page();
    if (!shown_.page.isNull()) return;  // arrives later, when the user may have closed the window
    show();
    raise();
}

QString CertificateView::html() const {
    const v1::Certificate& certificate = shown_.certificate;
    QString out;
    for (const v1::Verdict verdict : {v1::VERDICT_NO_GO, v1::VERDICT_CAUTION, v1::VERDICT_GO})
        for (const v1::CertificateFinding& finding : certificate.findings())
            if (finding.verdict() == verdict)
                out += QString("<p><b style='color:%1'>%2</b>&nbsp; %3</p>")
                           .arg(colour_of(verdict, theme_).name(), escaped(verdict_text(verdict)),
                                escaped(finding_line(finding)));
    out += "<table cellpadding='2'>";
    for (const auto& [name, value] : certificate_values(certificate))
        out += "<tr><td>" + escaped(name) + "&nbsp;&nbsp;</td><td><b>" + escaped(value) + "</b></td></tr>";
    return out + "</table><p></p>" + camera_table(certificate);
}

void CertificateView::show_page() {
    if (shown_.page.isNull()) return page_->setText(tr("Loading the page"));
    const qreal scale = devicePixelRatio();
    QPixmap page = QPixmap::fromImage(
        shown_.page.scaled(page_->size() * scale, Qt::KeepAspectRatio, Qt::SmoothTransformation));
    page.setDevicePixelRatio(scale);
    page_->setPixmap(page);
}

void CertificateView::resizeEvent(QResizeEvent* event) {
    QDialog::resizeEvent(event);
    if (!shown_.id.empty()) show_page();
}

void CertificateView::set_theme(const Theme& theme) {
    theme_ = theme;
    if (!shown_.id.empty()) text_->setHtml(html());
}

void CertificateView::save_page() {
    const QString name = QString::fromStdString(shown_.id) + " certificate.png";
    const QString file = QFileDialog::getSaveFileName(this, tr("Save page"), name, "PNG (*.png)");
    if (!file.isEmpty() && !shown_.page.save(file))
        QMessageBox::warning(this, tr("Save page"), tr("cannot write %1; choose another folder").arg(file));
}

}  // namespace kinevox::viewer
