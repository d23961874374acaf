// Chooses the daemon and the security of the connection. Settings are stored per daemon; of files, only the
// paths.
#pragma once

#include <QDialog>
#include <QStringList>

#include "client/lib/client_program.h"

class QCheckBox;
class QComboBox;
class QFormLayout;
class QLabel;
class QLineEdit;

namespace kinevox::viewer {

// Latest first.
QStringList recent_servers();
// The security of the latest connection; without TLS if there was none.
client::SecurityFiles stored_security(const QString& server);
void store_connection(const client::ConnectionOptions& connection);

class ConnectDialog final : public QDialog {
    Q_OBJECT

  public:
    explicit ConnectDialog(QWidget* parent);
    // After the dialog was accepted: open() succeeds.
    client::ConnectionOptions connection() const;

  private:
    QLineEdit* add_file(QFormLayout& form, const QString& label, const char* name, const QString& tip);
    void show_server(const QString& server);
    void try_connection();

    QComboBox* server_;
    QCheckBox* tls_;
    QLineEdit *ca_, *certificate_, *key_, *server_name_, *token_;
    QLabel* problem_;
};

}  // namespace kinevox::viewer
