// Cameras that began one by one: which of their images belong together, and what is written into
// session.toml.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "common/session_file.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;

Session session_with(const std::vector<std::optional<double>>& offsets_s, double fps = 10) {
    Session session;
    session.name = "phones", session.fps = fps;
    for (const auto& offset : offsets_s) {
        SessionCamera camera;
        camera.name = std::string(1, static_cast<char>('a' + session.cameras.size()));
        camera.offset_s = offset;
        session.cameras.push_back(camera);
    }
    return session;
}

TEST(SessionOffsets, FirstFrameSetIsTheLastCamerasStart) {
    EXPECT_FALSE(has_offsets(session_with({{}, {}})));
    EXPECT_THAT(first_image_indices(session_with({{}, {}})), ElementsAre(0, 0));
    const Session session = session_with({0.0, 0.7, {}, -0.3});
    EXPECT_TRUE(has_offsets(session));
    EXPECT_THAT(first_image_indices(session), ElementsAre(7, 0, 7, 10));
    const Session written = session_with({0.0, 0.233333, 0.033333}, 30);  // rounded to 6 decimals
    EXPECT_THAT(first_image_indices(written), ElementsAre(7, 0, 6));
}

// Each frame set spans less time than if every camera's begin were rounded by itself.
TEST(SessionOffsets, JoinsImagesWithinTheShortestTime) {
    for (const std::vector<double>& phases : {std::vector<double>{0, .04, .05, .06},
                                              {0, .09, .08, .01},
                                              {.05, .1, .15},
                                              {.02, .07},
                                              {0, .033, .066}}) {
        Session session = session_with({});
        for (double phase : phases) {
            session.cameras.emplace_back();
            session.cameras.back().offset_s = 0.3 + phase;
        }
        const auto first = first_image_indices(session);
        EXPECT_EQ(*std::min_element(first.begin(), first.end()), 0);
        double earliest = 1e9, latest = -1e9;
        for (std::size_t c = 0; c < first.size(); ++c) {
            const double taken = *session.cameras[c].offset_s * session.fps + static_cast<double>(first[c]);
            earliest = std::min(earliest, taken), latest = std::max(latest, taken);
        }
        // The best of all choices, by trying them.
        double best = 1e9;
        for (double cut : phases) {
            double low = 1e9, high = -1e9;
            for (double phase : phases) {
                double at = std::fmod((phase - cut) * session.fps + 1 + 1e-9, 1.0);
                low = std::min(low, at), high = std::max(high, at);
            }
            best = std::min(best, high - low);
        }
        EXPECT_NEAR(latest - earliest, best, 1e-6);
    }
}

TEST(SessionOffsets, FirstVideoToEndEndsAll) {
    const Session session = session_with({0.0, 0.7});
    const std::vector<std::int64_t> images{100, 95}, too_few{7, 95};
    EXPECT_EQ(*common_length(session, images), 93);
    const auto none = common_length(session, too_few);
    ASSERT_FALSE(none.ok());
    EXPECT_THAT(std::string(none.status().message()), HasSubstr("camera b begins when camera a has ended"));
}

constexpr const char* kText = R"(# My trial, phones on tripods.
name = "phones"   # in the hall
fps = 30.0
calibration = "calibration.toml"

[[camera]]   # by the door
name = "a"
video = "a.mp4"
background = "a.png"   # morning light

# the second
  [[camera]]
  name = "b"
  offset_s = 1.5  # by hand
  video = "b.mp4"

[[camera]]
name = "c"
video = "c.mp4")";

TEST(SessionOffsets, AreWrittenIntoTheText) {
    const std::vector<double> offsets{0, 0.2333333333, -1.25};
    const auto text = with_offsets(kText, offsets);
    ASSERT_TRUE(text.ok()) << text.status();
    std::string expected = kText;
    const auto change = [&](const std::string& from, const std::string& to) {
        const std::size_t at = expected.find(from);
        ASSERT_NE(at, std::string::npos);
        expected.replace(at, from.size(), to);
    };
    change("# morning light\n", "# morning light\noffset_s = 0.000000\n");
    change("offset_s = 1.5  #", "offset_s = 0.233333  #");
    change("video = \"c.mp4\"", "video = \"c.mp4\"\noffset_s = -1.250000\n");
    EXPECT_EQ(*text, expected);
    EXPECT_EQ(*with_offsets(*text, offsets), *text) << "once more changes nothing";
    EXPECT_FALSE(with_offsets(kText, std::vector<double>{0, 1}).ok());
}

class OffsetsOnDisk : public ::testing::Test {
  protected:
    void SetUp() override {
        for (const char* name : {"a.mp4", "b.mp4", "c.mp4", "a.png", "calibration.toml"})
            folder_.write(name, "");
    }
    std::string text() {
        std::ifstream stream(folder_ / "session.toml");
        return {std::istreambuf_iterator<char>(stream), {}};
    }
    testing::TemporaryFolder folder_;
};

TEST_F(OffsetsOnDisk, AreReadBack) {
    const auto file = folder_.write("session.toml", kText);
    const std::vector<double> offsets{0.5, 0, 2};
    ASSERT_TRUE(write_offsets(file, offsets).ok());
    const auto session = read_session(file);
    ASSERT_TRUE(session.ok()) << session.status();
    for (int c = 0; c < 3; ++c) EXPECT_EQ(session->cameras[c].offset_s, offsets[c]);
    EXPECT_THAT(text(), HasSubstr("# by the door"));
    ASSERT_TRUE(write_session(*session, file).ok());
    EXPECT_EQ(read_session(file)->cameras[2].offset_s, 2.0);
}

TEST_F(OffsetsOnDisk, AreWrittenForInlineTables) {
    const auto file =
        folder_.write("session.toml",
                      "fps = 30.0\nname = \"x\"\ncalibration = \"calibration.toml\"\n"
                      "camera = [{name = \"a\", video = \"a.mp4\"}, {name = \"b\", video = \"b.mp4\"}]\n");
    ASSERT_TRUE(write_offsets(file, std::vector<double>{0.25, 0}).ok());
    const auto session = read_session(file);
    ASSERT_TRUE(session.ok()) << session.status();
    EXPECT_EQ(session->cameras[0].offset_s, 0.25);
    EXPECT_EQ(session->cameras[1].name, "b");
}

TEST_F(OffsetsOnDisk, RejectsInvalidOffsets) {
    for (const auto& [value, extra] : {std::pair{"\"soon\"", ""},
                                       {"nan", ""},
                                       {"1e9", ""},
                                       {"0.5", "[recording]\nframe_times = \"a.mp4\"\n"}}) {
        folder_.write("session.toml",
                      std::string("fps = 30.0\ncalibration = \"calibration.toml\"\n[[camera]]\nname = \"a\"\n"
                                  "video = \"a.mp4\"\noffset_s = ") +
                          value + "\n" + extra);
        const auto session = read_session(folder_ / "session.toml");
        ASSERT_FALSE(session.ok()) << value;
        EXPECT_THAT(std::string(session.status().message()), HasSubstr("offset_s"));
        EXPECT_THAT(std::string(session.status().message()), HasSubstr("session.toml:6"));
    }
}

}  // namespace
}  // namespace kinevox
