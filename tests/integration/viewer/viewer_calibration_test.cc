// Calibration in the viewer's window, with a moving board and a real daemon.
#include <QCheckBox>
#include <QComboBox>
#include <QLabel>
#include <QListWidget>
#include <QPushButton>

#include "client/viewer/calibration_panel.h"
#include "tests/integration/daemon/board_session.h"
#include "tests/integration/viewer/viewer_fixture.h"

namespace kinevox::viewer {
namespace {

class ViewerCalibrationTest : public ViewerTest {
  protected:
    static void SetUpTestSuite() {
        shared_ = new testing::TemporaryFolder;
        session_ = testing::write_board_session(shared_->path()).session;
    }
    std::unique_ptr<testing::ChildProcess> start_on_board() {
        return start_daemon(
            session_config("127.0.0.1:0", "", "enabled = false\ndatabase_file = \"\"") +
            "[calibration]\nfolder = \"calibrations\"\n[pipeline]\nvoxel_mm = 50\ncolouring = false\n");
    }
    // Chooses the procedure in the panel.
    void choose(v1::ProcedureKind kind, bool board_on_floor) {
        press("calibrate");
        auto* kinds = panel().findChild<QComboBox*>("calibration_kind");
        kinds->setCurrentIndex(kinds->findData(static_cast<int>(kind)));
        panel().findChild<QComboBox*>("calibration_board")->setEditText(testing::kBoard);
        panel().findChild<QCheckBox*>()->setChecked(board_on_floor);
    }
    void click(const char* button) {
        auto* found = panel().findChild<QPushButton*>(button);
        ASSERT_TRUE(found && found->isEnabled() && found->isVisible())
            << button << ": " << window_->status_line().toStdString();
        QTest::mouseClick(found, Qt::LeftButton);
    }
    bool instructs(const char* text) {
        const auto* label = panel().findChild<QLabel*>("calibration_instruction");
        return label->isVisible() && label->text().contains(text);
    }
    CalibrationPanel& panel() { return window_->calibration(); }
    QListWidget& stored() { return *panel().findChild<QListWidget*>("calibrations"); }
    std::string state() {
        return window_->status_line().toStdString() + " / " +
               panel().findChild<QLabel*>("calibration_instruction")->text().toStdString() + " / " +
               panel().findChild<QLabel*>("calibration_hint")->text().toStdString();
    }
};

TEST_F(ViewerCalibrationTest, SolvesAppliesAndUndoesExtrinsicsFromBoard) {
    const auto daemon = start_on_board();
    show();
    ASSERT_TRUE(wait([&] { return window_->status_line().startsWith("Live"); })) << state();
    choose(v1::PROCEDURE_KIND_EXTRINSICS_BOARD, false);  // keeps the world frame of the published calibration
    save_screenshot("calibration_choice");
    click("calibration_begin");
    ASSERT_TRUE(wait([&] { return instructs("Move the board"); }, 2 * kTimeout_ms)) << state();
    ASSERT_TRUE(wait([&] {
        return panel().findChild<QLabel*>("calibration_hint")->text().contains("camera");
    })) << state();
    ASSERT_TRUE(
        wait([&] { return window_->calibration_progress().shared_frame_set_count() >= 20; }, 3 * kTimeout_ms))
        << state();
    save_screenshot("calibration");
    click("calibration_finish");  // it would wait for the floor, which is defined already
    ASSERT_TRUE(wait([&] { return panel().certificate().isVisible(); }, 3 * kTimeout_ms)) << state();
    const v1::Certificate& certificate = panel().certificate().shown().certificate;
    ASSERT_TRUE(certificate.verdict() == v1::VERDICT_GO || certificate.verdict() == v1::VERDICT_CAUTION)
        << certificate.DebugString();
    EXPECT_EQ(certificate.cameras_size(), 4);
    EXPECT_TRUE(certificate.world_defined());
    EXPECT_TRUE(wait([&] { return !panel().certificate().shown().page.isNull(); }, 2 * kTimeout_ms))
        << state();
    std::filesystem::create_directories(KINEVOX_VIEWER_IMAGES);
    EXPECT_TRUE(panel().certificate().grab().save(QString("%1/certificate.png").arg(KINEVOX_VIEWER_IMAGES)));
    panel().certificate().hide();
    ASSERT_TRUE(wait([&] { return stored().count() == 1; })) << state();
    EXPECT_FALSE(instructs(""));

    stored().setCurrentRow(0);
    click("calibration_apply");
    EXPECT_TRUE(wait([&] { return stored().count() == 1 && stored().item(0)->text().contains("active"); }))
        << state();
    EXPECT_TRUE(wait([&] { return window_->status_line().startsWith("Live"); })) << state();
    save_screenshot("calibration_used");
    click("calibration_undo");
    EXPECT_TRUE(wait([&] { return stored().count() == 1 && !stored().item(0)->text().contains("active"); }))
        << state();
    stored().setCurrentRow(0);
    click("calibration_delete");
    EXPECT_TRUE(wait([&] { return stored().count() == 0; })) << state();
}

TEST_F(ViewerCalibrationTest, ContinuesCollectingUntilCancelled) {
    const auto daemon = start_on_board();
    show();
    ASSERT_TRUE(wait([&] { return window_->status_line().startsWith("Live"); })) << state();
    choose(v1::PROCEDURE_KIND_EXTRINSICS_BOARD, true);
    click("calibration_begin");
    ASSERT_TRUE(wait([&] { return instructs("Lay the board on the floor"); })) << state();
    click("calibration_cancel");
    ASSERT_TRUE(wait([&] { return panel().findChild<QPushButton*>("calibration_begin")->isVisible(); }))
        << state();

    panel().findChild<QCheckBox*>()->setChecked(false);
    click("calibration_begin");
    ASSERT_TRUE(wait([&] { return instructs("Move the board"); })) << state();
    click("calibration_finish");  // with hardly any detections
    // Either the detections do not suffice and it continues to collect, or they do and it is stored. It must
    // not end in between.
    ASSERT_TRUE(wait([&] { return instructs("Move the board") || stored().count() == 1; }, 2 * kTimeout_ms))
        << state();
    if (stored().count() == 0) click("calibration_cancel");
    ASSERT_TRUE(wait([&] { return panel().findChild<QPushButton*>("calibration_begin")->isVisible(); }))
        << state();
    client::Client client({.server = address_});
    v1::ProcedureState last = v1::PROCEDURE_STATE_UNSPECIFIED;
    ASSERT_TRUE(client
                    .watch_procedure(
                        [&](const auto& progress) {
                            last = progress.state();
                            return false;
                        },
                        {})
                    .ok());
    EXPECT_NE(last, v1::PROCEDURE_STATE_COLLECTING) << "no open procedure is left behind";
}

TEST_F(ViewerCalibrationTest, ReportsProcedureThatCannotStart) {
    const auto daemon = start_on_board();
    show();
    ASSERT_TRUE(wait([&] { return window_->status_line().startsWith("Live"); })) << state();
    choose(v1::PROCEDURE_KIND_INTRINSICS, false);
    panel().findChild<QComboBox*>("calibration_board")->setEditText("a chessboard");
    click("calibration_begin");
    EXPECT_TRUE(wait([&] {
        return window_->latest_message().contains("Failed") &&
               window_->latest_message().contains("a chessboard");
    })) << state();
    EXPECT_TRUE(wait([&] { return panel().findChild<QPushButton*>("calibration_begin")->isVisible(); }))
        << state();
}

}  // namespace
}  // namespace kinevox::viewer
