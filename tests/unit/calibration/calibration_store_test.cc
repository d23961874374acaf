// The calibration store with damaged files and invalid ids.
#include "server/calibration/procedure/calibration_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/files.h"
#include "tests/support/fake_capture.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

using ::testing::SizeIs;

class CalibrationStoreTest : public ::testing::Test {
  protected:
    std::string add() {
        const auto id = store_.add(testing::fake_cameras(), "{}", "import", Verdict::kCaution, "a note", 1);
        EXPECT_TRUE(id.ok()) << id.status();
        return id.value_or("");
    }
    void damage(const std::string& id, const std::string& entry) {
        ASSERT_TRUE(write_file_atomically(folder_.path() / id / "calibration.json", entry).ok());
    }

    const testing::TemporaryFolder folder_;
    CalibrationStore store_{folder_.path(), "fake", testing::fake_cameras()};
};

TEST_F(CalibrationStoreTest, SkipsDamagedEntriesInTheListAndNamesThem) {
    const std::string intact = add(), damaged = add();
    for (const char* entry :
         {R"({"cameras": [{"name": 7}]})", R"({"cameras": [{"name": "left", "width": "64"}]})",
          R"({"cameras": [{"name": "left", "width": 64e30}]})",
          R"({"create_time_utc_ns": 18446744073709551615})", R"({"cameras": [3]})", R"({"cameras": 3})",
          R"({"note": []})", R"({"create_time_utc_ns": "now"})"}) {
        damage(damaged, entry);
        const auto list = store_.list();
        ASSERT_TRUE(list.ok()) << list.status();
        EXPECT_THAT(*list, SizeIs(1)) << entry;
        EXPECT_TRUE(absl::IsDataLoss(store_.find(damaged).status())) << entry;
    }
    EXPECT_TRUE(store_.find(intact).ok());
}

TEST_F(CalibrationStoreTest, MovesDeletedCalibrationsToTheBin) {
    const std::string first = add(), second = add();
    const auto bin = folder_.path() / "deleted";
    ASSERT_TRUE(store_.remove(second).ok());
    EXPECT_TRUE(absl::IsNotFound(store_.find(second).status()));
    EXPECT_TRUE(std::filesystem::exists(bin / second / "calibration.toml"));
    EXPECT_EQ(add(), "c3") << "an id in the bin is not used again";
    std::filesystem::rename(bin / second, folder_.path() / second);
    EXPECT_TRUE(store_.find(second).ok()) << "restored";

    // After a week the next deletion empties it.
    ASSERT_TRUE(store_.remove(first).ok());
    const auto now = std::filesystem::file_time_type::clock::now();
    std::filesystem::last_write_time(bin / first, now - std::chrono::hours(24 * 6));
    ASSERT_TRUE(store_.remove(second).ok());
    EXPECT_TRUE(std::filesystem::exists(bin / first));
    std::filesystem::last_write_time(bin / first, now - std::chrono::hours(24 * 8));
    ASSERT_TRUE(store_.remove("c3").ok());
    EXPECT_FALSE(std::filesystem::exists(bin / first));
    EXPECT_TRUE(std::filesystem::exists(bin / second));
}

TEST_F(CalibrationStoreTest, RefusesPathsAsIds) {
    const std::string id = add();
    for (const std::string& other :
         std::vector<std::string>{"../" + id, id + "/", "c01", "c1/../c1", "c99999999", "", "/etc"}) {
        EXPECT_TRUE(absl::IsNotFound(store_.find(other).status())) << other;
        EXPECT_FALSE(store_.remove(other).ok()) << other;
    }
    EXPECT_TRUE(store_.find(id).ok());
}

}  // namespace
}  // namespace kinevox
