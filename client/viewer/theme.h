// Dark and light.
#pragma once

#include <QColor>

class QApplication;

namespace kinevox::viewer {

struct Theme {
    bool dark = true;
    QColor background, floor_lines, floor_axis, text, faint, left, right, middle, good, care, bad;

    static Theme make(bool dark);
    void apply_to(QApplication& application) const;
};

}  // namespace kinevox::viewer
