#include "client/viewer/camera_panel.h"

#include <QPainter>
#include <algorithm>
#include <cmath>

#include "client/viewer/status_words.h"

namespace kinevox::viewer {
namespace {

constexpr int kGap_px = 4, kTextHeight_px = 18;
constexpr double kUsualShape = 4.0 / 3;  // width over height, before there is a picture

}  // namespace

CameraPanel::CameraPanel(QWidget* parent) : QWidget(parent) {
    setMinimumSize(200, 120);
}

void CameraPanel::show_previews(std::map<std::string, QImage> pictures) {
    pictures_ = std::move(pictures);
    update();
}

void CameraPanel::show_status(const v1::GetStatusResponse& status) {
    std::vector<Tile> tiles;
    for (const v1::CameraStatus& camera : status.cameras()) {
        const CameraTrouble trouble = camera_trouble(camera, status.has_subject());
        Tile tile{QString::fromStdString(camera.name()), tr(trouble.short_word.c_str()),
                  trouble.gravity == 0};
        tiles.push_back(std::move(tile));
    }
    const auto same = [](const Tile& a, const Tile& b) { return a.name == b.name && a.trouble == b.trouble; };
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
    double shape = kUsualShape;
    for (const auto& [name, picture] : pictures_)
        if (!picture.isNull()) shape = static_cast<double>(picture.width()) / picture.height();
    // As many columns as make the tiles largest.
    const int n = static_cast<int>(tiles_.size());
    int columns = 1;
    double best = 0;
    for (int c = 1; c <= n; ++c) {
        const int rows = (n + c - 1) / c;
        const double tile_height = static_cast<double>(height()) / rows - kTextHeight_px;
        const double tile_width = std::min(static_cast<double>(width()) / c, shape * tile_height);
        if (tile_width > best) best = tile_width, columns = c;
    }
    const int tile_width = static_cast<int>(best) - kGap_px,
              tile_height = static_cast<int>(tile_width / shape);
    for (int i = 0; i < n; ++i) {
        const Tile& tile = tiles_[static_cast<std::size_t>(i)];
        const QRect place(kGap_px / 2 + i % columns * (tile_width + kGap_px),
                          kGap_px / 2 + i / columns * (tile_height + kTextHeight_px + kGap_px), tile_width,
                          tile_height);
        const auto picture = pictures_.find(tile.name.toStdString());
        if (picture != pictures_.end() && !picture->second.isNull())
            painter.drawImage(place, picture->second);
        else
            painter.fillRect(place, theme_.floor_lines);
        const QRect text(place.left(), place.bottom() + 1, tile_width, kTextHeight_px);
        painter.setPen(tile.good ? theme_.text : theme_.care);
        painter.drawText(text, Qt::AlignVCenter | Qt::AlignLeft,
                         tile.good ? tile.name : tile.name + ": " + tile.trouble);
        if (!tile.good) {
            painter.setPen(QPen(theme_.care, 2));
            painter.drawRect(place);
        }
    }
}

}  // namespace kinevox::viewer
