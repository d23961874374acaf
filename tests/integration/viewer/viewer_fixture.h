// The viewer's window with a real daemon, in a virtual display. Screenshots stay in the build folder for
// inspection.
#pragma once

#include <signal.h>

#include <QAction>
#include <QApplication>
#include <QTest>

#include "client/viewer/main_window.h"
#include "client/viewer/scene_view.h"
#include "tests/integration/daemon/daemon_fixture.h"
#include "tests/support/patience.h"

namespace kinevox::viewer {

inline constexpr int kTimeout_ms = testing::patient(20'000);

// Coloured pixels of the scene: only the person is coloured.
inline int coloured_pixels(const QImage& image) {
    int count = 0;
    for (int y = 0; y < image.height(); ++y)
        for (int x = 0; x < image.width(); ++x) {
            const QColor c = image.pixelColor(x, y);
            if (c.hsvSaturation() > 60 && c.value() > 40) ++count;
        }
    return count;
}

inline int differing_pixels(const QImage& a, const QImage& b) {
    int count = 0;
    for (int y = 0; y < std::min(a.height(), b.height()); ++y)
        for (int x = 0; x < std::min(a.width(), b.width()); ++x) count += a.pixel(x, y) != b.pixel(x, y);
    return count;
}

class ViewerTest : public testing::DaemonTest {
  protected:
    static std::string config(const std::string& listen, const std::filesystem::path& recordings) {
        return session_config(listen,
                              fmt::format("pacing = \"real_time\"\nloop = true\n[recording]\nfolder = "
                                          "\"{}\"\nmax_buffer_s = 2\nmin_free_disk_mb = 1\n",
                                          recordings.string()),
                              "database_file = \"\"\nauto_fit_body = false");
    }
    void show(const client::SecurityFiles& files = {}) {
        window_ = std::make_unique<MainWindow>(client::ConnectionOptions{.server = address_, .files = files});
        window_->show();
        ASSERT_TRUE(QTest::qWaitForWindowExposed(window_.get(), kTimeout_ms));
        QApplication::setActiveWindow(window_.get());  // keys need it, and there is no window manager
    }
    bool wait(const std::function<bool()>& until, int limit_ms = kTimeout_ms) {
        return QTest::qWaitFor(until, limit_ms);
    }
    void press(const char* action) {
        auto* found = window_->findChild<QAction*>(action);
        ASSERT_TRUE(found && found->isEnabled()) << action << ": " << window_->status_line().toStdString();
        found->trigger();
    }
    void save_screenshot(const char* name) {
        std::filesystem::create_directories(KINEVOX_VIEWER_IMAGES);
        EXPECT_TRUE(window_->screenshot().save(QString("%1/%2.png").arg(KINEVOX_VIEWER_IMAGES, name)));
    }
    // Waits until `count` further results have arrived.
    bool results_arrive(std::uint64_t count) {
        const std::uint64_t begin = window_->feed().volume()->sequence;
        return wait(
            [&] {
                return window_->feed().volume()->sequence >= begin + count &&
                       !window_->feed().volume()->points.empty();
            },
            3 * kTimeout_ms);
    }
    bool shows_person() {
        return window_->feed().volume() && !window_->feed().volume()->points.empty() &&
               coloured_pixels(window_->scene().grabFramebuffer()) > 300;
    }

    // Of a point of the world, in the scene.
    QPoint pixel_of(const Vec3& at_m) {
        SceneView& scene = window_->scene();
        const float width_over_height = 1.f * scene.width() / scene.height();
        const QVector3D at = (scene.eye().clip_from_eye(width_over_height) * scene.eye().eye_from_world())
                                 .map(QVector3D(static_cast<float>(at_m.x), static_cast<float>(at_m.y),
                                                static_cast<float>(at_m.z)));
        return {static_cast<int>((0.5f + 0.5f * at.x()) * scene.width()),
                static_cast<int>((0.5f - 0.5f * at.y()) * scene.height())};
    }

    std::unique_ptr<MainWindow> window_;
};

}  // namespace kinevox::viewer
