#include "common/session_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "tests/support/temporary_folder.h"
#include "tests/support/test_data.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;

TEST(SessionFile, ReadsTruthAndCameras) {
    KINEVOX_REQUIRE_DATA(file, "studio/walk/session.toml");
    const auto session = read_session(file);
    ASSERT_TRUE(session.ok()) << session.status();
    EXPECT_EQ(session->name, "walk");
    EXPECT_EQ(session->fps, 30);
    ASSERT_EQ(session->cameras.size(), 4u);
    EXPECT_TRUE(session->cameras[2].video.is_absolute());
    EXPECT_TRUE(std::filesystem::exists(session->cameras[2].background));
    EXPECT_EQ(session->truth.filename(), "truth");
    const auto cameras = read_session_cameras(*session);
    ASSERT_TRUE(cameras.ok()) << cameras.status();
    EXPECT_EQ((*cameras)[3].name, "cam4");
}

TEST(SessionFile, SurvivesWritingAndReading) {
    const testing::TemporaryFolder folder, elsewhere;
    Session session;
    session.name = "sprint \"start\" 1";
    session.fps = 59.94;
    session.calibration = folder.write("calibration.toml", "");
    session.truth = folder.write("truth/joints.csv", "").parent_path();
    session.cameras = {{"cam_01", folder.write("videos/a.mp4", ""), folder.write("background/a.png", "")},
                       {"cam_02", elsewhere.write("b.mp4", ""), {}}};
    ASSERT_TRUE(write_session(session, folder / "session.toml").ok());
    std::ifstream stream(folder / "session.toml");
    const std::string text{std::istreambuf_iterator<char>(stream), {}};
    EXPECT_THAT(text, HasSubstr("\"videos/a.mp4\""));  // so that the folder can be moved
    const auto read = read_session(folder / "session.toml");
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_EQ(read->name, session.name);
    EXPECT_EQ(read->fps, session.fps);
    EXPECT_EQ(read->calibration, session.calibration);
    EXPECT_EQ(read->truth, session.truth);
    ASSERT_EQ(read->cameras.size(), 2u);
    for (int i = 0; i < 2; ++i) {
        EXPECT_EQ(read->cameras[i].name, session.cameras[i].name);
        EXPECT_EQ(read->cameras[i].video, session.cameras[i].video);
        EXPECT_EQ(read->cameras[i].background, session.cameras[i].background);
    }
}

TEST(SessionFile, NamesTheNewKeyOfRenamedOnes) {
    for (const auto& [before, now] : {std::pair{"times", "frame_times"},
                                      {"started_utc_ns", "start_time_utc_ns"},
                                      {"frames", "frame_sets"},
                                      {"dropped", "dropped_frame_sets"},
                                      {"lost", "lost_frame_sets"},
                                      {"missing_pictures", "missing_images"}}) {
        const std::string text = std::string(
                                     "fps = 30\ncalibration = \"c.toml\"\n\n[[camera]]\nname = \"a\"\n"
                                     "video = \"a.mkv\"\n\n[recording]\nframe_times = \"frames.csv\"\n") +
                                 before + " = 1\n";
        const auto session = parse_session_toml(text, "/folder", "session.toml", false);
        EXPECT_EQ(session.status().code(), absl::StatusCode::kInvalidArgument) << before;
        EXPECT_THAT(std::string(session.status().message()), HasSubstr(now));
        EXPECT_THAT(std::string(session.status().message()), HasSubstr("session.toml:"));
    }
}

}  // namespace
}  // namespace kinevox
