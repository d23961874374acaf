#include "client/viewer/theme.h"

#include <QApplication>
#include <QPalette>
#include <QStyleFactory>
#include <array>

#include "client/viewer/subjects.h"

namespace kinevox::viewer {

Theme Theme::make(bool dark) {
    Theme t;
    t.dark = dark;
    t.left = QColor(70, 160, 255);  // as in videos and reports: left blue, right orange
    t.right = QColor(255, 150, 40);
    t.good = QColor(70, 190, 110), t.warning = QColor(240, 170, 50), t.error = QColor(235, 80, 70);
    if (dark) {
        t.background = QColor(22, 24, 29), t.text = QColor(232, 234, 238), t.faint = QColor(150, 156, 166);
        t.floor_lines = QColor(58, 63, 72), t.floor_axis = QColor(96, 104, 118),
        t.midline = QColor(240, 240, 240);
    } else {
        t.background = QColor(244, 245, 247), t.text = QColor(28, 30, 34), t.faint = QColor(110, 115, 124);
        t.floor_lines = QColor(206, 210, 216), t.floor_axis = QColor(150, 156, 166),
        t.midline = QColor(40, 42, 48);
    }
    return t;
}

// Distinct from left, right and the states of the status line where possible.
QColor Theme::subject(std::uint32_t number) const {
    static const std::array kColours{QColor(80, 210, 130), QColor(225, 95, 205),  QColor(235, 215, 70),
                                     QColor(70, 215, 220), QColor(165, 130, 255), QColor(240, 110, 110),
                                     QColor(170, 220, 60), QColor(205, 170, 130)};
    static_assert(kColours.size() == Subjects::kColours);
    const QColor& colour = kColours[(number + kColours.size() - 1) % kColours.size()];
    return dark ? colour : colour.darker(130);
}

void Theme::apply_to(QApplication& application) const {
    application.setStyle(QStyleFactory::create("Fusion"));
    QPalette p;
    const QColor window = dark ? QColor(32, 35, 41) : QColor(250, 250, 251);
    const QColor raised = dark ? QColor(44, 48, 56) : QColor(236, 238, 241);
    p.setColor(QPalette::Window, window);
    p.setColor(QPalette::Base, background);
    p.setColor(QPalette::AlternateBase, raised);
    p.setColor(QPalette::Button, raised);
    p.setColor(QPalette::ToolTipBase, raised);
    for (const auto role : {QPalette::WindowText, QPalette::Text, QPalette::ButtonText, QPalette::ToolTipText,
                            QPalette::BrightText})
        p.setColor(role, text);
    p.setColor(QPalette::PlaceholderText, faint);
    p.setColor(QPalette::Highlight, QColor(48, 120, 210));
    p.setColor(QPalette::HighlightedText, Qt::white);
    for (const auto role : {QPalette::WindowText, QPalette::Text, QPalette::ButtonText})
        p.setColor(QPalette::Disabled, role, faint.darker(dark ? 140 : 90));
    application.setPalette(p);
}

}  // namespace kinevox::viewer
