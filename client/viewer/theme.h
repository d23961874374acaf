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
    // Of a subject among several, by the number of its colour, from 1 (Subjects::colours).
    QColor subject(std::uint32_t number) const;
    void apply_to(QApplication& application) const;
};

}  // namespace kinevox::viewer
