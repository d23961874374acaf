// kinevox-viewer: see the athlete.
#include <QApplication>
#include <QCommandLineParser>
#include <QTimer>

#include <cmath>
#include <cstdio>

#include "client/viewer/main_window.h"
#include "client/viewer/scene_view.h"

int main(int argc, char** argv) {
    QApplication application(argc, argv);
    QApplication::setOrganizationName("Kinevox");
    QApplication::setApplicationName("viewer");
    QApplication::setApplicationVersion(KINEVOX_VERSION);
    QCommandLineParser parser;
    parser.setApplicationDescription(
        "Shows what a Kinevox daemon sees: the athlete's volume, skeleton and angles, live or replayed.");
    parser.addHelpOption();
    parser.addVersionOption();
    const QCommandLineOption server("server", "The daemon, HOST:PORT; else KINEVOX_SERVER, else 127.0.0.1:50770.", "HOST:PORT");
    parser.addOption(server);
    const QCommandLineOption picture("picture", "Write the window as PNG after --after seconds, say how it went, and end.",
                                     "FILE");
    const QCommandLineOption after("after", "Seconds until the picture is taken.", "SECONDS", "5");
    parser.addOptions({picture, after});
    parser.process(application);

    QString address = parser.value(server);
    if (address.isEmpty()) address = qEnvironmentVariable("KINEVOX_SERVER", "127.0.0.1:50770");
    kinevox::viewer::MainWindow window(address);
    window.show();
    if (parser.isSet(picture))
        QTimer::singleShot(static_cast<int>(1000 * parser.value(after).toDouble()), &window, [&] {
            const QString file = parser.value(picture);
            const bool written = window.picture().save(file);
            std::printf("%.1f volumes a second painted, %.1f ms behind\n", window.scene().painted_volumes_per_second(),
                        window.scene().delay_ms().value_or(std::nan("")));
            if (!written) qCritical("kinevox-viewer: %s cannot be written; give another FILE", qPrintable(file));
            QApplication::exit(written ? 0 : 1);
        });
    return QApplication::exec();
}
