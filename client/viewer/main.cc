// kinevox-viewer: shows the athlete, live or replayed.
#include <CLI/CLI.hpp>
#include <QApplication>
#include <QTimer>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "client/viewer/connect_dialog.h"
#include "client/viewer/main_window.h"
#include "client/viewer/scene_view.h"
#include "common/command_line.h"

namespace {

using namespace kinevox;

struct Screenshot {
    std::string file;
    double delay_s = 5;
};

void take_screenshot(viewer::MainWindow& window, const Screenshot& screenshot) {
    const bool written = window.screenshot().save(QString::fromStdString(screenshot.file));
    std::printf("%.1f volumes per second painted, latency %.1f ms\n",
                window.scene().painted_volumes_per_second(),
                window.scene().latency_ms().value_or(std::nan("")));
    if (!written)
        std::fprintf(stderr, "kinevox-viewer: cannot write %s; choose another file\n",
                     screenshot.file.c_str());
    QApplication::exit(written ? 0 : 1);
}

}  // namespace

int main(int argc, char** argv) {
    CLI::App app(
        "Viewer for coaches: the athlete's volume, skeleton and angles of a Kinevox daemon, live or "
        "replayed.",
        "kinevox-viewer");
    app.set_version_flag("--version", std::string("kinevox-viewer ") + KINEVOX_VERSION);
    client::ConnectionOptions connection;
    client::add_connection_options(app, connection);
    Screenshot screenshot;
    app.add_option("--screenshot", screenshot.file,
                   "Save a screenshot (PNG) after --screenshot-delay, then exit")
        ->type_name("FILE");
    app.add_option("--screenshot-delay", screenshot.delay_s, "Time until the screenshot (s)")
        ->capture_default_str();
    app.allow_extras();  // Qt's own options
    // Before QApplication, which needs a display: --help must not.
    if (const auto ended = parse_command_line(app, argc, argv)) return *ended;

    std::vector<std::string> qt_options = app.remaining();
    std::vector<char*> qt_argv{argv[0]};
    for (std::string& option : qt_options) qt_argv.push_back(option.data());
    int qt_argc = static_cast<int>(qt_argv.size());
    qt_argv.push_back(nullptr);
    QApplication application(qt_argc, qt_argv.data());  // removes the options that it knows
    if (qt_argc > 1) {
        std::fprintf(stderr, "kinevox-viewer: unknown option %s; see kinevox-viewer --help\n", qt_argv[1]);
        return 1;
    }
    QApplication::setOrganizationName("Kinevox");
    QApplication::setApplicationName("viewer");

    // Without options, the security of the latest connection to this daemon.
    if (!connection.files.tls && connection.files.ca.empty() && connection.files.token.empty())
        connection.files = viewer::stored_security(QString::fromStdString(connection.server));
    if (const absl::Status status = connection.open().status(); !status.ok()) {
        std::fprintf(stderr, "kinevox-viewer: %s\n", std::string(status.message()).c_str());
        return 1;
    }
    viewer::MainWindow window(connection);
    window.show();
    if (!screenshot.file.empty())
        QTimer::singleShot(static_cast<int>(1000 * screenshot.delay_s), &window,
                           [&] { take_screenshot(window, screenshot); });
    return QApplication::exec();
}
