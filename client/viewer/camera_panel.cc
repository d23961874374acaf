#include "client/viewer/camera_panel.h"

#include <QPainter>
#include <algorithm>
#include <cmath>

#include "client/viewer/feed.h"

namespace kinevox::viewer {
namespace {

constexpr int kGap_px = 4, kTextHeight_px = 18;
constexpr double kDefaultAspect = 4.0 / 3;  // width over height, before the first image

}  // namespace

CameraPanel::CameraPanel(QWidget* parent) : QWidget(parent) {
    setMinimumSize(200, 120);
}

void CameraPanel::show_previews(std::map<std::string, QImage> images) {
    images_ = std::move(images);
    update();
}

void CameraPanel::show_status(const v1::GetStatusResponse& status) {
    std::vector<Tile> tiles;
    for (const v1::CameraStatus& camera : status.cameras()) {
        const CameraIssue issue = camera_issue(camera, status.subjects_size() > 0);
        Tile tile{QString::fromStdString(camera.name()), tr(issue.label.c_str()), issue.severity == 0};
        tiles.push_back(std::move(tile));
    }
    const auto same = [](const Tile& a, const Tile& b) { return a.name == b.name && a.issue == b.issue; };
    if (std::ranges::equal(tiles, tiles_, same)) return;
    tiles_ = std::move(tiles);
    update();
}

void CameraPanel::set_theme(const Theme& theme) {
    theme_ = theme;
    update();
}

void CameraPanel::paintEvent(QPaintEvent*) {
    QPainter painter(this);
    painter.fillRect(rect(), theme_.background);
    if (tiles_.empty()) return;
    double aspect = kDefaultAspect;
    for (const auto& [name, image] : images_)
        if (!image.isNull()) aspect = static_cast<double>(image.width()) / image.height();
    // The number of columns that makes the tiles largest.
    const int n = static_cast<int>(tiles_.size());
    int columns = 1;
    double best = 0;
    for (int c = 1; c <= n; ++c) {
        const int rows = (n + c - 1) / c;
        const double tile_height = static_cast<double>(height()) / rows - kTextHeight_px;
        const double tile_width = std::min(static_cast<double>(width()) / c, aspect * tile_height);
        if (tile_width > best) best = tile_width, columns = c;
    }
    const int tile_width = static_cast<int>(best) - kGap_px,
              tile_height = static_cast<int>(tile_width / aspect);
    for (int i = 0; i < n; ++i) {
        const Tile& tile = tiles_[static_cast<std::size_t>(i)];
        const QRect frame(kGap_px / 2 + i % columns * (tile_width + kGap_px),
                          kGap_px / 2 + i / columns * (tile_height + kTextHeight_px + kGap_px), tile_width,
                          tile_height);
        const auto image = images_.find(tile.name.toStdString());
        if (image != images_.end() && !image->second.isNull())
            painter.drawImage(frame, image->second);
        else
            painter.fillRect(frame, theme_.floor_lines);
        const QRect text(frame.left(), frame.bottom() + 1, tile_width, kTextHeight_px);
        painter.setPen(tile.good ? theme_.text : theme_.warning);
        painter.drawText(text, Qt::AlignVCenter | Qt::AlignLeft,
                         tile.good ? tile.name : tile.name + ": " + tile.issue);
        if (!tile.good) {
            painter.setPen(QPen(theme_.warning, 2));
            painter.drawRect(frame);
        }
    }
}

}  // namespace kinevox::viewer
