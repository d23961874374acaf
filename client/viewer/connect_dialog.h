// Which daemon, and how it is spoken to; each daemon's choices are remembered, files by their names alone.
#pragma once

#include <QDialog>
#include <QStringList>

#include "client/lib/connection_options.h"

class QCheckBox;
class QComboBox;
class QFormLayout;
class QLabel;
class QLineEdit;

namespace kinevox::viewer {

// The newest first.
QStringList recent_servers();
// As it was spoken to last; without TLS where it never was.
client::SecurityFiles remembered_security(const QString& server);
void remember(const client::ConnectionOptions& connection);

class ConnectDialog final : public QDialog {
    Q_OBJECT

  public:
    explicit ConnectDialog(QWidget* parent);
    // Can be opened, once the dialogue is accepted.
    client::ConnectionOptions connection() const;

  private:
    QLineEdit* add_file(QFormLayout& form, const QString& label, const char* name, const QString& tip);
    void show_server(const QString& server);
    void try_it();

    QComboBox* server_;
    QCheckBox* tls_;
    QLineEdit *ca_, *certificate_, *key_, *server_name_, *token_;
    QLabel* problem_;
};

}  // namespace kinevox::viewer
