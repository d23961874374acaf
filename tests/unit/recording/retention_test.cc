// Which recordings go, and that nothing remains of them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "common/files.h"
#include "server/recording/recording_list.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::IsEmpty;

constexpr std::int64_t kDay_ns = 86'400'000'000'000, kNow_ns = 20'000 * kDay_ns;

RecordingInfo recording(const std::string& name, double days_old, std::uint64_t bytes) {
    RecordingInfo info;
    info.name = name;
    info.session_file = "/nowhere/" + name + "/session.toml";
    info.size_bytes = bytes;
    info.about.closed = true;
    info.about.start_time_utc_ns =
        kNow_ns - static_cast<std::int64_t>(days_old * static_cast<double>(kDay_ns));
    return info;
}

const std::vector<RecordingInfo> kThree{recording("old", 40, 100), recording("newer", 5, 100),
                                        recording("new", 1, 100)};

TEST(Retention, KeepsAllWithoutLimits) {
    EXPECT_THAT(due_for_deletion(kThree, {}, kNow_ns), IsEmpty());
}

TEST(Retention, DeletesOldRecordings) {
    EXPECT_THAT(due_for_deletion(kThree, {.retention_days = 30}, kNow_ns), ElementsAre("old"));
    EXPECT_THAT(due_for_deletion(kThree, {.retention_days = 0.5}, kNow_ns),
                ElementsAre("old", "newer", "new"));
    EXPECT_THAT(due_for_deletion(kThree, {.retention_days = 40.001}, kNow_ns), IsEmpty());
}

TEST(Retention, DeletesOldestAboveTotalSize) {
    EXPECT_THAT(due_for_deletion(kThree, {.max_total_bytes = 300}, kNow_ns), IsEmpty());
    EXPECT_THAT(due_for_deletion(kThree, {.max_total_bytes = 299}, kNow_ns), ElementsAre("old"));
    EXPECT_THAT(due_for_deletion(kThree, {.max_total_bytes = 150}, kNow_ns), ElementsAre("old", "newer"));
    EXPECT_THAT(due_for_deletion({kThree[2], kThree[0], kThree[1]}, {.max_total_bytes = 299}, kNow_ns),
                ElementsAre("old"))
        << "in whatever order they were listed";
    EXPECT_THAT(due_for_deletion(kThree, {.retention_days = 3, .max_total_bytes = 250}, kNow_ns),
                ElementsAre("old", "newer"));
}

TEST(Retention, KeepsRunningRecording) {
    auto recordings = kThree;
    recordings[0].about.closed = false;
    EXPECT_THAT(due_for_deletion(recordings, {.retention_days = 3}, kNow_ns), ElementsAre("newer"));
    EXPECT_THAT(due_for_deletion(recordings, {.max_total_bytes = 299}, kNow_ns), ElementsAre("newer"));
}

class RetentionOnDisk : public ::testing::Test {
  protected:
    void SetUp() override {
        folder_ =
            fs::path(::testing::TempDir()) / ::testing::UnitTest::GetInstance()->current_test_info()->name();
        fs::remove_all(folder_);
    }
    void TearDown() override { fs::remove_all(folder_); }

    // A closed recording of one camera that began `days` ago.
    void record(const std::string& name, double days) {
        const fs::path into = folder_ / name;
        fs::create_directories(into);
        Session session;
        session.name = name;
        session.fps = 30;
        session.calibration = into / "calibration.toml";
        session.cameras.push_back({"cam1", into / "cam1.mkv", into / "empty.mkv", {}});
        session.recording.emplace();
        session.recording->frame_times = into / "frames.csv";
        session.recording->closed = true;
        session.recording->start_time_utc_ns =
            kNow_ns - static_cast<std::int64_t>(days * static_cast<double>(kDay_ns));
        for (const char* file :
             {"calibration.toml", "cam1.mkv", "empty.mkv", "frames.csv", "poses/joints.csv"})
            ASSERT_TRUE(
                write_file_atomically(into / file, "frame,sequence,time_ns,capture_time_utc_ns\n").ok());
        ASSERT_TRUE(write_session(session, into / "session.toml").ok());
    }
    std::vector<std::string> names() const {
        std::vector<std::string> found;
        for (const auto& entry : fs::directory_iterator(folder_))
            found.push_back(entry.path().filename().string());
        std::ranges::sort(found);
        return found;
    }
    std::vector<std::string> apply(const RetentionLimits& limits, const fs::path& spared = {}) {
        std::vector<std::string> reported;
        apply_retention(folder_, limits, kNow_ns, spared,
                        [&](const std::string& name, const absl::Status& deleted) {
                            EXPECT_TRUE(deleted.ok()) << deleted;
                            reported.push_back(name);
                        });
        return reported;
    }
    fs::path folder_;
};

TEST_F(RetentionOnDisk, DeletesWholeFolders) {
    record("a", 40), record("b", 2);
    EXPECT_THAT(apply({.retention_days = 30}), ElementsAre("a"));
    EXPECT_THAT(names(), ElementsAre("b"));
}

TEST_F(RetentionOnDisk, KeepsPinnedAndReplayedRecordings) {
    record("a", 40), record("b", 41), record("c", 42);
    std::ofstream(folder_ / "a" / kPinnedFile);
    EXPECT_THAT(apply({.retention_days = 30}, folder_ / "b" / "session.toml"), ElementsAre("c"));
    EXPECT_THAT(names(), ElementsAre("a", "b"));
}

TEST_F(RetentionOnDisk, SweepsInterruptedDeletions) {
    record("a", 1);
    fs::create_directories(folder_ / ".deleted-x");
    std::ofstream(folder_ / ".deleted-x" / "cam1.mkv") << "images";
    apply({});
    EXPECT_THAT(names(), ElementsAre("a"));
}

TEST_F(RetentionOnDisk, BinIsEmptiedAfterSomeDays) {
    record("a", 3), record("b", 2);
    ASSERT_TRUE(move_recording_to_bin(folder_, "a").ok());
    EXPECT_THAT(names(), ElementsAre("b", "deleted"));
    ASSERT_EQ(list_bin(folder_).size(), 1U);
    const auto deleted = [&](double days_ago) {
        const auto age = std::chrono::duration<double>(86400 * days_ago);
        const auto time = std::chrono::sys_time<std::chrono::nanoseconds>(std::chrono::nanoseconds(kNow_ns)) -
                          std::chrono::duration_cast<std::chrono::nanoseconds>(age);
        fs::last_write_time(folder_ / "deleted" / "a", std::chrono::file_clock::from_sys(time));
    };
    deleted(kBinDays - 1);
    apply({});
    EXPECT_EQ(list_bin(folder_).size(), 1U);
    deleted(kBinDays + 1);
    EXPECT_THAT(apply({}), IsEmpty());
    EXPECT_THAT(list_bin(folder_), IsEmpty());
    EXPECT_THAT(list_recordings(folder_), ::testing::SizeIs(1));
}

TEST_F(RetentionOnDisk, BinGoesBeforeRecordings) {
    record("a", 3), record("b", 2);
    const std::uint64_t bytes = recording_size_bytes(folder_ / "a");
    ASSERT_TRUE(move_recording_to_bin(folder_, "a").ok());
    fs::last_write_time(folder_ / "deleted" / "a",
                        std::chrono::file_clock::from_sys(std::chrono::sys_time<std::chrono::nanoseconds>(
                            std::chrono::nanoseconds(kNow_ns))));
    EXPECT_THAT(apply({.max_total_bytes = 3 * bytes / 2}), IsEmpty());
    EXPECT_THAT(list_bin(folder_), IsEmpty());
    EXPECT_THAT(names(), ElementsAre("b", "deleted"));
}

TEST_F(RetentionOnDisk, LeavesOtherFoldersAlone) {
    record("a", 40);
    fs::create_directories(folder_ / "notes");
    std::ofstream(folder_ / "notes" / "text.txt") << "mine";
    EXPECT_THAT(apply({.retention_days = 1, .max_total_bytes = 1}), ElementsAre("a"));
    EXPECT_THAT(names(), ElementsAre("notes"));
}

}  // namespace
}  // namespace kinevox
