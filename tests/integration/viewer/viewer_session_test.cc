// The viewer with a recorded session of an athlete and with the virtual studio.
#include <QComboBox>
#include <QListWidget>

#include "client/viewer/angle_panel.h"
#include "client/viewer/replay_bar.h"
#include "client/viewer/subjects.h"
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

TEST_F(ViewerSessionTest, ShowsSeveralAthletesAndSelectsOne) {
    KINEVOX_REQUIRE_DATA(pair, "studio/pair/session.toml");
    const auto daemon = start_daemon(fmt::format("[server]\nlisten = \"127.0.0.1:0\"\n[source]\nkind = "
                                                 "\"session\"\nsession_file = \"{}\"\npacing = "
                                                 "\"real_time\"\nloop = true\n[tracking]\nmax_subjects = 2\n",
                                                 pair.string()) +
                                     recording());
    show();
    const Subjects& subjects = window_->subjects();
    ASSERT_TRUE(wait([&] { return subjects.several() && shows_person(); }, 2 * kTimeout_ms))
        << window_->status_line().toStdString();
    auto* choice = window_->angles().findChild<QComboBox*>("subject");
    ASSERT_TRUE(wait([&] { return choice->isVisible() && choice->count() == 2; }));
    const std::uint32_t first = subjects.selected();
    press("next_subject");
    const std::uint32_t other = subjects.selected();
    EXPECT_NE(other, first);
    EXPECT_TRUE(wait([&] { return choice->currentData().toUInt() == other; }));

    // A click on the other one selects it; a drag does not.
    SceneView& scene = window_->scene();
    scene.set_following(false);
    scene.eye() = OrbitCamera{.distance_m = 7};
    scene.update();
    QTest::qWait(300);
    const auto pixel_of_subject = [&](std::uint32_t id) {
        const auto volume = window_->feed().volume();  // another thread replaces it at any time
        const ShownSubject* subject = volume->subject(id);
        return subject ? pixel_of(subject->centre_in_world) : QPoint();
    };
    EXPECT_TRUE(wait([&] {
        QTest::mouseClick(&scene, Qt::LeftButton, {}, pixel_of_subject(first));
        return subjects.selected() == first;
    }));
    const QPoint there = pixel_of_subject(other);
    QTest::mousePress(&scene, Qt::LeftButton, {}, there - QPoint(30, 0));
    QTest::mouseMove(&scene, there);
    QTest::mouseRelease(&scene, Qt::LeftButton, {}, there);
    EXPECT_EQ(subjects.selected(), first);

    auto* compared = window_->angles().findChild<QComboBox*>("compared_subject");
    compared->setCurrentIndex(compared->findData(other));
    Q_EMIT compared->activated(compared->currentIndex());
    EXPECT_EQ(subjects.compared(), other);
    scene.eye() = OrbitCamera{.distance_m = 5.5f};
    ASSERT_TRUE(results_arrive(60)) << window_->status_line().toStdString();
    save_screenshot("several");
    window_->save_plots_in(QString::fromStdString(folder_.path().string()));
    std::filesystem::copy_file(folder_.path() / "knee_flexion_geometric_l.png",
                               std::filesystem::path(KINEVOX_VIEWER_IMAGES) / "several_plot.png",
                               std::filesystem::copy_options::overwrite_existing);
}

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
