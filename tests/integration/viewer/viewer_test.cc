// The viewer's window with a real daemon.
#include <QListWidget>
#include <QSlider>

#include "client/viewer/angle_panel.h"
#include "client/viewer/ghost.h"
#include "client/viewer/replay_bar.h"
#include "tests/integration/viewer/viewer_fixture.h"

namespace kinevox::viewer {
namespace {

// A rigid person who moves along x at 1 m/s.
std::string walking_joints() {
    std::string csv = "frame,time_s";
    for (const std::string_view joint : kJointNames) csv += fmt::format(",{0}_x,{0}_y,{0}_z", joint);
    for (int n = 0; n < 100; ++n) {
        csv += fmt::format("\n{},{}", n, 0.02 * n);
        for (std::size_t j = 0; j < kJointNames.size(); ++j) {
            const double side = kJointNames[j].ends_with("_l")   ? 0.2
                                : kJointNames[j].ends_with("_r") ? -0.2
                                                                 : 0;
            csv += fmt::format(",{},{},{}", 0.02 * n, side, 1.7 - 0.08 * static_cast<double>(j % 12));
        }
    }
    return csv + "\n";
}

TEST_F(ViewerTest, ShowsAthleteAndRotatesScene) {
    const auto daemon = start_daemon(config("127.0.0.1:0", folder_.path() / "recordings"));
    show();
    ASSERT_TRUE(wait([&] { return shows_person(); })) << window_->status_line().toStdString();
    EXPECT_TRUE(wait([&] { return window_->status_line().contains("4 cameras"); }))
        << window_->status_line().toStdString();
    EXPECT_TRUE(wait([&] { return window_->feed().previews().size() == 4; }));
    save_screenshot("live");

    SceneView& scene = window_->scene();
    scene.set_following(false);
    press("images");
    const float azimuth = scene.eye().azimuth_deg;
    const QPoint centre(scene.width() / 2, scene.height() / 2);
    QTest::mousePress(&scene, Qt::LeftButton, {}, centre);
    QTest::mouseMove(&scene, centre + QPoint(120, 0));
    QTest::mouseRelease(&scene, Qt::LeftButton, {}, centre + QPoint(120, 0));
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
    save_screenshot("light");
    press("light");
}

TEST_F(ViewerTest, ReportsWhyThereAreNoImages) {
    const auto tokens = folder_.path() / "tokens.toml";
    const auto made = testing::run(
        {KINEVOX_TOKEN, "create", "coach", "--file", tokens.string(), "--role", "viewer"}, folder_.path());
    ASSERT_EQ(made.status, 0) << made.errors;
    std::string text = config("127.0.0.1:0", folder_.path() / "recordings");
    text.insert(text.find('\n') + 1,
                fmt::format("token_file = \"{}\"\naudit_file = \"\"\n", tokens.string()));
    const auto daemon = start_daemon(text);
    show({.token = write("coach.token", made.output).string()});
    ASSERT_TRUE(wait([&] { return shows_person(); })) << window_->status_line().toStdString();
    EXPECT_TRUE(wait([&] { return window_->latest_message().startsWith("No images: "); }))
        << window_->latest_message().toStdString();
    EXPECT_TRUE(window_->latest_message().contains("the token coach has viewer"))
        << window_->latest_message().toStdString();
    save_screenshot("no_images");
}

TEST_F(ViewerTest, RecordsAndReplays) {
    const auto daemon = start_daemon(config("127.0.0.1:0", folder_.path() / "recordings"));
    show();
    ASSERT_TRUE(wait([&] { return shows_person(); })) << window_->status_line().toStdString();
    auto* record = window_->findChild<QAction*>("record");
    ASSERT_TRUE(wait([&] { return record->isEnabled(); }));
    press("record");
    ASSERT_TRUE(wait([&] { return window_->findChild<QAction*>("record")->text() == "Stop recording"; }))
        << window_->status_line().toStdString();
    QTest::qWait(1000);
    press("record");
    auto* list = window_->findChild<QListWidget*>("recordings");
    ASSERT_TRUE(wait([&] { return list->count() == 1 && record->text() == "Record"; }))
        << window_->status_line().toStdString();
    ASSERT_TRUE(wait([&] { return window_->findChild<QAction*>("save_buffer")->isEnabled(); }));
    press("save_buffer");
    ASSERT_TRUE(wait([&] { return list->count() == 2; })) << window_->status_line().toStdString();

    Q_EMIT list->itemActivated(list->item(1));
    ASSERT_TRUE(wait([&] { return window_->status_line().startsWith("Replay"); }))
        << window_->status_line().toStdString();
    ASSERT_TRUE(wait([&] { return window_->feed().volume()->recorded_frame.has_value() && shows_person(); }));
    save_screenshot("replay");
    QTest::keyClick(window_.get(), Qt::Key_Space);
    ASSERT_TRUE(wait([&] { return window_->status_line().startsWith("Replay, paused"); }))
        << window_->status_line().toStdString();
    // A slow machine may still process a frame, and may have read one more than it reported.
    const auto* timeline = window_->findChild<ReplayBar*>()->findChild<QSlider*>();
    QTest::qWait(1500);
    ASSERT_TRUE(wait([&] { return window_->feed().volume()->recorded_frame == timeline->value(); }))
        << timeline->value();
    const std::int64_t frame = timeline->value();
    QTest::keyClick(window_.get(), Qt::Key_Left);
    EXPECT_TRUE(wait([&] {
        return window_->feed().volume()->recorded_frame == std::max<std::int64_t>(0, frame - 1);
    })) << frame
        << ", now " << window_->feed().volume()->recorded_frame.value_or(-1) << " and " << timeline->value()
        << " of the timeline, " << window_->status_line().toStdString();
}

TEST_F(ViewerTest, ShowsGhostOverReplayAndMarksInPlots) {
    const auto daemon = start_daemon(config("127.0.0.1:0", folder_.path() / "recordings"));
    show();
    ASSERT_TRUE(wait([&] { return shows_person(); })) << window_->status_line().toStdString();
    auto* list = window_->findChild<QListWidget*>("recordings");
    for (int recordings = 1; recordings <= 2; ++recordings) {
        ASSERT_TRUE(wait([&] { return window_->findChild<QAction*>("record")->isEnabled(); }));
        press("record");
        ASSERT_TRUE(wait([&] { return window_->findChild<QAction*>("record")->text() == "Stop recording"; }))
            << window_->status_line().toStdString();
        ASSERT_TRUE(results_arrive(30)) << window_->status_line().toStdString();
        press("record");
        ASSERT_TRUE(wait([&] { return list->count() == recordings; }))
            << window_->status_line().toStdString();
    }

    // Live, the ghost stands at its event until M is pressed.
    list->setCurrentRow(1);
    QTest::keyClick(window_.get(), Qt::Key_G);
    ASSERT_TRUE(wait([&] { return window_->ghost().match().ghost() != nullptr; }))
        << window_->latest_message().toStdString();
    EXPECT_FALSE(window_->ghost().match().shown_event_s());
    EXPECT_TRUE(window_->findChild<GhostBar*>()->isVisible());
    QTest::keyClick(window_.get(), Qt::Key_M);
    EXPECT_TRUE(window_->ghost().match().shown_event_s());
    QTest::qWait(500);
    save_screenshot("ghost_live");
    ASSERT_NO_FATAL_FAILURE(press("skeleton"));
    ASSERT_NO_FATAL_FAILURE(press("skeleton"));
    window_->save_plots_in(QString::fromStdString(folder_.path().string()));
    EXPECT_GT(std::filesystem::file_size(folder_.path() / "knee_flexion_geometric_l.pdf"), 1000U);
    EXPECT_FALSE(
        QImage(QString::fromStdString((folder_.path() / "knee_flexion_geometric_l.png").string())).isNull());
    std::filesystem::copy_file(folder_.path() / "knee_flexion_geometric_l.png",
                               std::string(KINEVOX_VIEWER_IMAGES) + "/plot.png",
                               std::filesystem::copy_options::overwrite_existing);

    // Replayed, with a ghost whose frames are known; stepping keeps both together.
    window_->ghost().choose_file(QString::fromStdString(write("joints.csv", walking_joints())));
    Q_EMIT list->itemActivated(list->item(0));
    ASSERT_TRUE(wait([&] { return window_->findChild<ReplayBar*>()->isVisible(); }))
        << window_->latest_message().toStdString();
    QTest::keyClick(window_.get(), Qt::Key_Space);
    ASSERT_TRUE(wait([&] { return window_->status_line().startsWith("Replay, paused"); }))
        << window_->status_line().toStdString();
    Q_EMIT window_->findChild<ReplayBar*>()->seek(0);
    const GhostMatch& match = window_->ghost().match();
    const auto ghost_x_m = [&] {
        return window_->ghost().pose()->joints_in_world[0].value_or(Vec3{-1, 0, 0}).x;
    };
    ASSERT_TRUE(wait([&] { return match.shown_event_s() == 0.0 && ghost_x_m() == 0; })) << match.problem();
    QTest::keyClick(window_.get(), Qt::Key_Right);  // frames are 1/20 s apart, the ghost moves at 1 m/s
    EXPECT_TRUE(wait([&] { return std::abs(ghost_x_m() - 0.05) < 1e-6; })) << ghost_x_m();
    QTest::keyClick(window_.get(), Qt::Key_Left);
    EXPECT_TRUE(wait([&] { return ghost_x_m() == 0; })) << ghost_x_m();
    QTest::keyClick(window_.get(), Qt::Key_Period);  // ahead
    EXPECT_NEAR(ghost_x_m(), 0.02, 1e-6);
    save_screenshot("ghost");
    press("no_ghost");
    EXPECT_FALSE(window_->findChild<GhostBar*>()->isVisible());

    // The replayed recording, from the current frame.
    QTest::keyClick(window_.get(), Qt::Key_G, Qt::ShiftModifier);
    EXPECT_TRUE(wait([&] { return match.ghost() && match.ghost_event_s().value_or(-1) >= 0; }))
        << window_->status_line().toStdString();
}

TEST_F(ViewerTest, StaysResponsiveAndReconnectsWithoutDaemon) {
    auto daemon = start_daemon(config("127.0.0.1:0", folder_.path() / "recordings"));
    const std::string address = address_;
    show();
    ASSERT_TRUE(wait([&] { return shows_person(); })) << window_->status_line().toStdString();

    daemon->signal(SIGSTOP);  // the network stalls
    EXPECT_TRUE(wait([&] {
        return window_->status_line().startsWith("Stalled") ||
               window_->status_line().startsWith("No connection");
    })) << window_->status_line().toStdString();
    const std::uint64_t paints = window_->scene().paints();
    for (int n = 0; n < 20; ++n) {
        QTest::mousePress(&window_->scene(), Qt::LeftButton, {}, QPoint(200, 200));
        QTest::mouseMove(&window_->scene(), QPoint(210 + n, 200));
        QTest::mouseRelease(&window_->scene(), Qt::LeftButton, {}, QPoint(210 + n, 200));
        QTest::qWait(30);
    }
    EXPECT_GE(window_->scene().paints() - paints, 15U) << "the scene rotates without messages";
    daemon->signal(SIGCONT);
    EXPECT_TRUE(wait([&] { return window_->status_line().startsWith("Live"); }))
        << window_->status_line().toStdString();

    daemon->signal(SIGKILL);
    daemon->wait(std::chrono::seconds(5));
    EXPECT_TRUE(wait([&] { return window_->status_line().startsWith("No connection"); }, 5000))
        << window_->status_line().toStdString();
    EXPECT_TRUE(window_->status_line().contains("reconnecting")) << window_->status_line().toStdString();
    save_screenshot("gone");
    const std::uint64_t last = window_->feed().volume()->sequence;
    daemon = start_daemon(config(address, folder_.path() / "recordings"));
    EXPECT_TRUE(wait([&] { return window_->status_line().startsWith("Live"); }))
        << window_->status_line().toStdString();
    EXPECT_TRUE(wait([&] { return window_->feed().volume()->sequence != last && shows_person(); }))
        << window_->status_line().toStdString();
}

TEST_F(ViewerTest, ReportsUnreachableDaemon) {
    address_ = "127.0.0.1:1";
    show();
    EXPECT_TRUE(wait([&] {
        return window_->status_line().contains("127.0.0.1:1") &&
               window_->status_line().contains("reconnecting");
    })) << window_->status_line().toStdString();
}

}  // namespace
}  // namespace kinevox::viewer
