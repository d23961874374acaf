// The viewer with a recorded session of an athlete and with the virtual studio.
#include <QListWidget>

#include "client/viewer/replay_bar.h"
#include "tests/integration/viewer/viewer_fixture.h"
#include "tests/support/test_data.h"

namespace kinevox::viewer {
namespace {

class ViewerSessionTest : public ViewerTest {
  protected:
    // Connects, orbits, plots, records, replays, loses the daemon and reconnects.
    void use(const std::function<std::string(const std::string& listen)>& config, const std::string& name) {
        auto daemon = start_daemon(config("127.0.0.1:0"));
        const std::string address = address_;
        show();
        ASSERT_TRUE(wait([&] { return shows_person(); }, 2 * kTimeout_ms))
            << window_->status_line().toStdString();
        SceneView& scene = window_->scene();
        const QPoint centre(scene.width() / 2, scene.height() / 2);
        const float azimuth = scene.eye().azimuth_deg;
        QTest::mousePress(&scene, Qt::LeftButton, {}, centre);
        QTest::mouseMove(&scene, centre + QPoint(90, 0));
        QTest::mouseRelease(&scene, Qt::LeftButton, {}, centre + QPoint(90, 0));
        QTest::qWait(50);
        EXPECT_NE(scene.eye().azimuth_deg, azimuth);
        ASSERT_TRUE(wait([&] { return window_->findChild<QAction*>("record")->isEnabled(); }));
        press("record");
        ASSERT_TRUE(wait([&] { return window_->findChild<QAction*>("record")->text() == "Stop recording"; }))
            << window_->status_line().toStdString();
        QTest::keyClick(window_.get(), Qt::Key_M);
        ASSERT_TRUE(results_arrive(30)) << window_->status_line().toStdString();
        save_screenshot((name + "_live").c_str());
        window_->save_plots_in(QString::fromStdString(folder_.path().string()));
        EXPECT_GT(std::filesystem::file_size(folder_.path() / "knee_flexion_geometric_l.png"), 1000U);
        press("record");
        auto* list = window_->findChild<QListWidget*>("recordings");
        ASSERT_TRUE(wait([&] { return list->count() == 1; }, 2 * kTimeout_ms))
            << window_->status_line().toStdString();
        Q_EMIT list->itemActivated(list->item(0));
        ASSERT_TRUE(wait([&] { return window_->findChild<ReplayBar*>()->isVisible(); }, 3 * kTimeout_ms))
            << window_->latest_message().toStdString();
        Q_EMIT window_->findChild<ReplayBar*>()->speed(0.1);  // so that a slow machine skips no frames
        ASSERT_TRUE(wait(
            [&] {
                return window_->status_line().startsWith("Replay") &&
                       window_->feed().volume()->recorded_frame && shows_person();
            },
            2 * kTimeout_ms))
            << window_->status_line().toStdString();
        save_screenshot((name + "_replay").c_str());

        daemon->signal(SIGKILL);
        daemon->wait(std::chrono::seconds(5));
        EXPECT_TRUE(wait([&] { return window_->status_line().startsWith("No connection"); }))
            << window_->status_line().toStdString();
        const std::uint64_t last = window_->feed().volume()->sequence;
        daemon = start_daemon(config(address));
        EXPECT_TRUE(wait([&] { return window_->feed().volume()->sequence != last && shows_person(); },
                         2 * kTimeout_ms))
            << window_->status_line().toStdString();
    }
    std::string recording() const {
        return fmt::format(
            "[pose]\ndatabase_file = \"\"\nauto_fit_body = false\n[recording]\nfolder = "
            "\"{}\"\nmin_free_disk_mb = 1\n",
            (folder_.path() / "recordings").string());
    }
};

TEST_F(ViewerSessionTest, ShowsBalancingAthlete) {
    KINEVOX_REQUIRE_DATA(session, "balancing/session.toml");
    use(
        [&](const std::string& listen) {
            return fmt::format(
                       "[server]\nlisten = \"{}\"\n[source]\nkind = \"session\"\nsession_file = "
                       "\"{}\"\npacing = "
                       "\"real_time\"\n"
                       "loop = true\n",
                       listen, session.string()) +
                   recording();
        },
        "balancing");
}

TEST_F(ViewerSessionTest, ShowsVirtualStudio) {
    use(
        [&](const std::string& listen) {
            return fmt::format(
                       "[server]\nlisten = \"{}\"\n[source.studio]\nwidth_px = 320\nheight_px = 240\nfps = "
                       "10.0\n",
                       listen) +
                   recording();
        },
        "studio");
}

}  // namespace
}  // namespace kinevox::viewer
