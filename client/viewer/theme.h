// Colours of the dark and the light theme.
#pragma once

#include <QColor>

class QApplication;

namespace kinevox::viewer {

struct Theme {
    bool dark = true;
    QColor background, floor_lines, floor_axis, text, faint, left, right, midline, good, warning, error;

    static Theme make(bool dark);
    void apply_to(QApplication& application) const;
};

}  // namespace kinevox::viewer
