#include "client/viewer/connect_dialog.h"

#include <QCheckBox>
#include <QComboBox>
#include <QDialogButtonBox>
#include <QFileDialog>
#include <QFormLayout>
#include <QHBoxLayout>
#include <QLabel>
#include <QLineEdit>
#include <QPushButton>
#include <QSettings>
#include <utility>

namespace kinevox::viewer {
namespace {

constexpr int kMaxRecent = 8, kWidth_px = 520;

QString group_of(const QString& server) {
    return "security/" + QString(server).replace('/', '_');
}

}  // namespace

QStringList recent_servers() {
    return QSettings().value("servers").toStringList();
}

client::SecurityFiles stored_security(const QString& server) {
    QSettings settings;
    settings.beginGroup(group_of(server));
    const auto text = [&](const char* key) { return settings.value(key).toString().toStdString(); };
    client::SecurityFiles files;
    files.tls = settings.value("tls", false).toBool();
    files.ca = text("ca");
    files.certificate = text("certificate");
    files.key = text("key");
    files.server_name = text("server_name");
    files.token = text("token_file");
    return files;
}

void store_connection(const client::ConnectionOptions& connection) {
    const QString server = QString::fromStdString(connection.server);
    QSettings settings;
    QStringList recent = recent_servers();
    recent.removeAll(server);
    recent.prepend(server);
    settings.setValue("servers", QStringList(recent.mid(0, kMaxRecent)));
    for (const QString& dropped : recent.mid(kMaxRecent)) settings.remove(group_of(dropped));
    settings.beginGroup(group_of(server));
    const client::SecurityFiles& files = connection.files;
    settings.setValue("tls", files.tls);
    for (const auto& [key, text] : {std::pair{"ca", files.ca},
                                    {"certificate", files.certificate},
                                    {"key", files.key},
                                    {"server_name", files.server_name},
                                    {"token_file", files.token}})
        settings.setValue(key, QString::fromStdString(text));
}

ConnectDialog::ConnectDialog(QWidget* parent) : QDialog(parent) {
    setObjectName("connect_dialog");
    setWindowTitle(tr("Connect"));
    setMinimumWidth(kWidth_px);
    auto* form = new QFormLayout(this);
    server_ = new QComboBox(this);
    server_->setObjectName("server");
    server_->setEditable(true);
    server_->addItems(recent_servers());
    form->addRow(tr("Daemon (HOST:PORT)"), server_);
    tls_ = new QCheckBox(tr("Use TLS"), this);
    tls_->setObjectName("tls");
    form->addRow(QString(), tls_);
    ca_ = add_file(*form, tr("CA certificate"), "ca",
                   tr("CA certificate that signed the daemon's (PEM); empty: system CAs"));
    certificate_ =
        add_file(*form, tr("Client certificate"), "certificate", tr("PEM; for daemons that require it"));
    key_ = add_file(*form, tr("Client key"), "key", tr("PEM"));
    server_name_ = new QLineEdit(this);
    server_name_->setPlaceholderText(tr("same as HOST"));
    form->addRow(tr("Name in the daemon's certificate"), server_name_);
    token_ = add_file(*form, tr("Token file"), "token",
                      tr("The first line is the access token; only the path is stored"));
    problem_ = new QLabel(this);
    problem_->setObjectName("problem");
    problem_->setWordWrap(true);
    form->addRow(problem_);
    auto* buttons = new QDialogButtonBox(QDialogButtonBox::Ok | QDialogButtonBox::Cancel, this);
    buttons->button(QDialogButtonBox::Ok)->setText(tr("Connect"));
    form->addRow(buttons);
    connect(buttons, &QDialogButtonBox::accepted, this, &ConnectDialog::try_connection);
    connect(buttons, &QDialogButtonBox::rejected, this, &QDialog::reject);
    connect(server_, &QComboBox::textActivated, this, &ConnectDialog::show_server);
    show_server(server_->currentText());
}

QLineEdit* ConnectDialog::add_file(QFormLayout& form, const QString& label, const char* name,
                                   const QString& tip) {
    auto* line = new QLineEdit(this);
    line->setObjectName(name);
    line->setToolTip(tip);
    line->setPlaceholderText(tr("none"));
    auto* choose = new QPushButton(tr("Choose..."), this);
    choose->setAutoDefault(false);
    connect(choose, &QPushButton::clicked, this, [this, line, label] {
        const QString file = QFileDialog::getOpenFileName(this, label, line->text());
        if (!file.isEmpty()) line->setText(file);
    });
    auto* row = new QHBoxLayout;
    row->addWidget(line, 1);
    row->addWidget(choose);
    form.addRow(label, row);
    return line;
}

void ConnectDialog::show_server(const QString& server) {
    const client::SecurityFiles files = stored_security(server);
    tls_->setChecked(files.tls);
    for (const auto& [line, text] : {std::pair{ca_, files.ca},
                                     {certificate_, files.certificate},
                                     {key_, files.key},
                                     {server_name_, files.server_name},
                                     {token_, files.token}})
        line->setText(QString::fromStdString(text));
}

client::ConnectionOptions ConnectDialog::connection() const {
    const auto text = [](const QLineEdit* line) { return line->text().trimmed().toStdString(); };
    client::ConnectionOptions connection;
    connection.server = server_->currentText().trimmed().toStdString();
    connection.files = {tls_->isChecked(), text(ca_),          text(certificate_),
                        text(key_),        text(server_name_), text(token_)};
    return connection;
}

// Errors of the files are shown in the dialog, where they can be fixed.
void ConnectDialog::try_connection() {
    const client::ConnectionOptions options = this->connection();
    if (options.server.empty()) return problem_->setText(tr("enter HOST:PORT of the daemon"));
    const absl::Status status = options.open().status();
    if (status.ok()) return accept();
    problem_->setText(QString::fromStdString(std::string(status.message())));
}

}  // namespace kinevox::viewer
