// Colours of the dark and the light theme.
#pragma once

#include <QColor>
#include <cstdint>

class QApplication;

namespace kinevox::viewer {

struct Theme {
    bool dark = true;
    QColor background, floor_lines, floor_axis, text, faint, left, right, midline, good, warning, error;

    static Theme make(bool dark);
    // Of a subject among several; the same for an id at all times.
    QColor subject(std::uint32_t id) const;
    void apply_to(QApplication& application) const;
};

}  // namespace kinevox::viewer
