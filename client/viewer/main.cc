// kinevox-viewer: see the athlete.
#include <CLI/CLI.hpp>
#include <QApplication>
#include <QTimer>
#include <cmath>
#include <cstdio>

#include "client/viewer/connect_dialog.h"
#include "client/viewer/main_window.h"
#include "client/viewer/scene_view.h"

int main(int argc, char** argv) {
    QApplication application(argc, argv);  // takes Qt's own options away
    QApplication::setOrganizationName("Kinevox");
    QApplication::setApplicationName("viewer");
    CLI::App app(
        "Shows what a Kinevox daemon sees: the athlete's volume, skeleton and angles, live or replayed.");
    app.set_version_flag("--version", std::string("kinevox-viewer ") + KINEVOX_VERSION);
    kinevox::client::ConnectionOptions connection;
    kinevox::client::add_connection_options(app, connection);
    std::string picture;
    double after_s = 5;
    app.add_option("--picture", picture,
                   "Write the window as PNG after --after seconds, say how it went, and end");
    app.add_option("--after", after_s, "Seconds until the picture is taken")->capture_default_str();
    CLI11_PARSE(app, argc, argv);

    if (!connection.files.tls && connection.files.ca.empty() &&
        connection.files.token.empty())  // as it was spoken to last
        connection.files = kinevox::viewer::remembered_security(QString::fromStdString(connection.server));
    if (const absl::Status status = connection.open().status(); !status.ok()) {
        std::fprintf(stderr, "kinevox-viewer: %s\n", std::string(status.message()).c_str());
        return 1;
    }
    kinevox::viewer::MainWindow window(connection);
    window.show();
    if (!picture.empty())
        QTimer::singleShot(static_cast<int>(1000 * after_s), &window, [&] {
            const bool written = window.picture().save(QString::fromStdString(picture));
            std::printf("%.1f volumes a second painted, %.1f ms behind\n",
                        window.scene().painted_volumes_per_second(),
                        window.scene().delay_ms().value_or(std::nan("")));
            if (!written)
                std::fprintf(stderr, "kinevox-viewer: %s cannot be written; give another FILE\n",
                             picture.c_str());
            QApplication::exit(written ? 0 : 1);
        });
    return QApplication::exec();
}
