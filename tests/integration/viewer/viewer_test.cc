// The viewer's window against a real daemon: what a coach does, in a display of its own. Its pictures stay in the build
// folder, to be looked at.
#include <QAction>
#include <QApplication>
#include <QListWidget>
#include <QTest>

#include <signal.h>

#include "client/viewer/angle_panel.h"
#include "client/viewer/main_window.h"
#include "client/viewer/scene_view.h"
#include "tests/integration/daemon/daemon_fixture.h"

namespace kinevox::viewer {
namespace {

constexpr int kSoon_ms = 20'000;

// Pixels of the scene that are coloured, as only the person is.
int coloured_pixels(const QImage& picture) {
    int count = 0;
    for (int y = 0; y < picture.height(); ++y)
        for (int x = 0; x < picture.width(); ++x) {
            const QColor c = picture.pixelColor(x, y);
            if (c.hsvSaturation() > 60 && c.value() > 40) ++count;
        }
    return count;
}

int differing_pixels(const QImage& a, const QImage& b) {
    int count = 0;
    for (int y = 0; y < std::min(a.height(), b.height()); ++y)
        for (int x = 0; x < std::min(a.width(), b.width()); ++x) count += a.pixel(x, y) != b.pixel(x, y);
    return count;
}

class ViewerTest : public testing::DaemonTest {
  protected:
    static std::string config(const std::string& listen, const std::filesystem::path& recordings) {
        return session_config(listen, fmt::format("pacing = \"real_time\"\nloop = true\n[recording]\nfolder = \"{}\"\nkeep_last_s = 2\nleast_free_mb = 1\n",
                                                  recordings.string()),
                              "database = \"\"\nfit_body = false");
    }
    void show() {
        window_ = std::make_unique<MainWindow>(QString::fromStdString(address_));
        window_->show();
        ASSERT_TRUE(QTest::qWaitForWindowExposed(window_.get(), kSoon_ms));
        QApplication::setActiveWindow(window_.get());   // no window manager does it here; keys need it
    }
    bool wait(const std::function<bool()>& until, int limit_ms = kSoon_ms) { return QTest::qWaitFor(until, limit_ms); }
    void press(const char* action) {
        auto* found = window_->findChild<QAction*>(action);
        ASSERT_TRUE(found && found->isEnabled()) << action << ": " << window_->status_line().toStdString();
        found->trigger();
    }
    void keep_picture(const char* name) {
        std::filesystem::create_directories(KINEVOX_VIEWER_PICTURES);
        EXPECT_TRUE(window_->picture().save(QString("%1/%2.png").arg(KINEVOX_VIEWER_PICTURES, name)));
    }
    bool sees_a_person() {
        return window_->feed().volume() && !window_->feed().volume()->points.empty() &&
               coloured_pixels(window_->scene().grabFramebuffer()) > 300;
    }

    std::unique_ptr<MainWindow> window_;
};

TEST_F(ViewerTest, AnAthleteIsSeenWithoutADialogueAndTheSceneTurns) {
    const auto daemon = start_daemon(config("127.0.0.1:0", folder_.path() / "recordings"));
    show();
    ASSERT_TRUE(wait([&] { return sees_a_person(); })) << window_->status_line().toStdString();
    EXPECT_TRUE(wait([&] { return window_->status_line().contains("4 cameras"); })) << window_->status_line().toStdString();
    EXPECT_TRUE(wait([&] { return window_->feed().previews().size() == 4; }));
    keep_picture("live");

    SceneView& scene = window_->scene();
    scene.set_following(false);
    press("pictures");
    const float azimuth = scene.eye().azimuth_deg;
    const QPoint middle(scene.width() / 2, scene.height() / 2);
    QTest::mousePress(&scene, Qt::LeftButton, {}, middle);
    QTest::mouseMove(&scene, middle + QPoint(120, 0));
    QTest::mouseRelease(&scene, Qt::LeftButton, {}, middle + QPoint(120, 0));
    QTest::qWait(50);
    EXPECT_NE(scene.eye().azimuth_deg, azimuth);
    const QImage before = scene.grabFramebuffer();
    press("top");
    EXPECT_TRUE(wait([&] { return differing_pixels(before, scene.grabFramebuffer()) > 2000; }));
    press("front");
    press("volume");
    EXPECT_TRUE(wait([&] { return coloured_pixels(scene.grabFramebuffer()) < 3000; }));
    press("volume");
    press("silhouettes");
    EXPECT_TRUE(wait([&] {
        const auto previews = window_->feed().previews();
        return previews.size() == 4 && !previews.begin()->second.isNull();
    }));
    press("light");
    QTest::qWait(300);
    keep_picture("light");
    press("light");
}

TEST_F(ViewerTest, RecordsAndReplays) {
    const auto daemon = start_daemon(config("127.0.0.1:0", folder_.path() / "recordings"));
    show();
    ASSERT_TRUE(wait([&] { return sees_a_person(); })) << window_->status_line().toStdString();
    auto* record = window_->findChild<QAction*>("record");
    ASSERT_TRUE(wait([&] { return record->isEnabled(); }));
    press("record");
    ASSERT_TRUE(wait([&] { return window_->status_line().contains("recording \""); })) << window_->status_line().toStdString();
    QTest::qWait(1000);
    press("record");
    auto* list = window_->findChild<QListWidget*>();
    ASSERT_TRUE(wait([&] { return list->count() == 1 && record->text() == "Record"; })) << window_->status_line().toStdString();
    ASSERT_TRUE(wait([&] { return window_->findChild<QAction*>("keep")->isEnabled(); }));
    press("keep");
    ASSERT_TRUE(wait([&] { return list->count() == 2; })) << window_->status_line().toStdString();

    Q_EMIT list->itemActivated(list->item(1));
    ASSERT_TRUE(wait([&] { return window_->status_line().startsWith("Replay"); })) << window_->status_line().toStdString();
    ASSERT_TRUE(wait([&] { return window_->feed().volume()->recorded_frame.has_value() && sees_a_person(); }));
    keep_picture("replay");
    QTest::keyClick(window_.get(), Qt::Key_Space);
    ASSERT_TRUE(wait([&] { return window_->status_line().startsWith("Replay, paused"); })) << window_->status_line().toStdString();
    QTest::qWait(300);
    const std::int64_t frame = window_->feed().volume()->recorded_frame.value();
    QTest::keyClick(window_.get(), Qt::Key_Left);
    EXPECT_TRUE(wait([&] { return window_->feed().volume()->recorded_frame == std::max<std::int64_t>(0, frame - 1); }))
        << frame << " " << window_->status_line().toStdString();
}

TEST_F(ViewerTest, LosesTheDaemonSaysSoStaysSmoothAndFindsItAgain) {
    auto daemon = start_daemon(config("127.0.0.1:0", folder_.path() / "recordings"));
    const std::string address = address_;
    show();
    ASSERT_TRUE(wait([&] { return sees_a_person(); })) << window_->status_line().toStdString();

    daemon->signal(SIGSTOP);   // the network stalls
    EXPECT_TRUE(wait([&] { return window_->status_line().startsWith("Stalled") || window_->status_line().startsWith("No connection"); }))
        << window_->status_line().toStdString();
    const std::uint64_t paints = window_->scene().paints();
    for (int n = 0; n < 20; ++n) {
        QTest::mousePress(&window_->scene(), Qt::LeftButton, {}, QPoint(200, 200));
        QTest::mouseMove(&window_->scene(), QPoint(210 + n, 200));
        QTest::mouseRelease(&window_->scene(), Qt::LeftButton, {}, QPoint(210 + n, 200));
        QTest::qWait(30);
    }
    EXPECT_GE(window_->scene().paints() - paints, 15U) << "the scene turns while nothing comes";
    daemon->signal(SIGCONT);
    EXPECT_TRUE(wait([&] { return window_->status_line().startsWith("Live"); })) << window_->status_line().toStdString();

    daemon->signal(SIGKILL);
    daemon->wait(std::chrono::seconds(5));
    EXPECT_TRUE(wait([&] { return window_->status_line().startsWith("No connection"); }, 5000)) << window_->status_line().toStdString();
    EXPECT_TRUE(window_->status_line().contains("trying again")) << window_->status_line().toStdString();
    keep_picture("gone");
    const std::uint64_t last = window_->feed().volume()->sequence;
    daemon = start_daemon(config(address, folder_.path() / "recordings"));
    EXPECT_TRUE(wait([&] { return window_->status_line().startsWith("Live"); })) << window_->status_line().toStdString();
    EXPECT_TRUE(wait([&] { return window_->feed().volume()->sequence != last && sees_a_person(); })) << window_->status_line().toStdString();
}

TEST_F(ViewerTest, NobodyThereIsSaidInPlainWords) {
    address_ = "127.0.0.1:1";
    show();
    EXPECT_TRUE(wait([&] { return window_->status_line().contains("127.0.0.1:1") && window_->status_line().contains("trying again"); }))
        << window_->status_line().toStdString();
}

}  // namespace
}  // namespace kinevox::viewer

int main(int argc, char** argv) {
    ::testing::InitGoogleTest(&argc, argv);
    const kinevox::testing::TemporaryFolder settings;
    qputenv("XDG_CONFIG_HOME", settings.path().c_str());
    QApplication application(argc, argv);
    QApplication::setOrganizationName("Kinevox");
    QApplication::setApplicationName("viewer");
    return RUN_ALL_TESTS();
}
