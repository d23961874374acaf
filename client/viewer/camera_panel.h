// The cameras' images or silhouettes side by side, each with its name and issue.
#pragma once

#include <QImage>
#include <QWidget>
#include <map>
#include <string>

#include "client/viewer/theme.h"
#include "kinevox/v1/capture_service.pb.h"

namespace kinevox::viewer {

class CameraPanel final : public QWidget {
    Q_OBJECT

  public:
    explicit CameraPanel(QWidget* parent = nullptr);
    void show_previews(std::map<std::string, QImage> images);
    void show_status(const v1::GetStatusResponse& status);
    void set_theme(const Theme& theme);

  protected:
    void paintEvent(QPaintEvent* event) override;

  private:
    struct Tile {
        QString name, issue;
        bool good = true;
    };
    std::vector<Tile> tiles_;
    std::map<std::string, QImage> images_;
    Theme theme_ = Theme::make(true);
};

}  // namespace kinevox::viewer
