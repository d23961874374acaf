#include "common/proto_time.h"

#include <gtest/gtest.h>

#include <limits>

namespace kinevox {
namespace {

using namespace std::chrono_literals;

TEST(ProtoTime, TimestampsAreExact) {
    for (const std::int64_t utc_ns : {0L, 1L, -1L, 1'767'225'600'123'456'789L, -1'500'000'000L}) {
        const google::protobuf::Timestamp time = to_timestamp(utc_ns);
        EXPECT_EQ(to_utc_ns(time), utc_ns);
        EXPECT_GE(time.nanos(), 0);
        EXPECT_LT(time.nanos(), 1'000'000'000);
    }
    EXPECT_EQ(to_timestamp(-1).seconds(), -1);
    EXPECT_EQ(to_timestamp(-1).nanos(), 999'999'999);
}

TEST(ProtoTime, DurationsAreExact) {
    EXPECT_EQ(to_duration(1500ms).seconds(), 1);
    EXPECT_EQ(to_duration(1500ms).nanos(), 500'000'000);
    EXPECT_EQ(to_milliseconds(to_duration(1500ms)), 1500ms);
    EXPECT_DOUBLE_EQ(to_seconds(duration_from_s(0.1)), 0.1);
    EXPECT_EQ(duration_from_s(-1.5).nanos(), -500'000'000);
    EXPECT_EQ(to_milliseconds(duration_from_s(1e-6)), 1ms) << "rounded up";
    EXPECT_EQ(to_milliseconds({}), 0ms);
}

TEST(ProtoTime, ExtremeValuesSaturate) {
    google::protobuf::Timestamp time;
    time.set_seconds(std::numeric_limits<std::int64_t>::max());
    EXPECT_GT(to_utc_ns(time), 0);
    google::protobuf::Duration duration;
    duration.set_seconds(std::numeric_limits<std::int64_t>::min());
    duration.set_nanos(std::numeric_limits<std::int32_t>::min());
    EXPECT_LT(to_milliseconds(duration), 0ms);
    EXPECT_GT(duration_from_s(1e300).seconds(), 0);
    EXPECT_EQ(duration_from_s(std::numeric_limits<double>::quiet_NaN()).seconds(), 0);
}

}  // namespace
}  // namespace kinevox
