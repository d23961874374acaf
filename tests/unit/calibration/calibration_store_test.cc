// The calibrations that a daemon keeps, where their files are not what it wrote.
#include "server/calibration/calibration_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "common/atomic_file.h"
#include "tests/support/fake_capture.h"
#include "tests/unit/common/temporary_folder.h"

namespace kinevox {
namespace {

using ::testing::SizeIs;

class CalibrationStoreTest : public ::testing::Test {
  protected:
    std::string add() {
        const auto id = store_.add(testing::fake_cameras(), "{}", "import", Verdict::kCare, "a note", 1);
        EXPECT_TRUE(id.ok()) << id.status();
        return id.value_or("");
    }
    void damage(const std::string& id, const std::string& about) {
        ASSERT_TRUE(write_file_atomically(folder_.path() / id / "about.json", about).ok());
    }

    const testing::TemporaryFolder folder_;
    CalibrationStore store_{folder_.path(), "fake", testing::fake_cameras()};
};

TEST_F(CalibrationStoreTest, AnAboutOfAnotherShapeIsLeftOutOfTheListAndNamed) {
    const std::string whole = add(), damaged = add();
    for (const char* about :
         {R"({"cameras": [{"name": 7}]})", R"({"cameras": [{"name": "left", "width": "64"}]})",
          R"({"cameras": [{"name": "left", "width": 64e30}]})", R"({"time_utc_ns": 18446744073709551615})",
          R"({"cameras": [3]})", R"({"cameras": 3})", R"({"note": []})", R"({"time_utc_ns": "now"})"}) {
        damage(damaged, about);
        const auto list = store_.list();
        ASSERT_TRUE(list.ok()) << list.status();
        EXPECT_THAT(*list, SizeIs(1)) << about;
        EXPECT_TRUE(absl::IsDataLoss(store_.find(damaged).status())) << about;
    }
    EXPECT_TRUE(store_.find(whole).ok());
}

TEST_F(CalibrationStoreTest, WhatIsNoIdIsNoPath) {
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
