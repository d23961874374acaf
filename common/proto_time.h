// The API's times and durations (google.protobuf.Timestamp, Duration) to and from numbers. Values outside the
// range of a result saturate, because messages come from other programs.
#pragma once

#include <google/protobuf/duration.pb.h>
#include <google/protobuf/timestamp.pb.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdint>

namespace kinevox {

inline constexpr std::int64_t kNanosecondsPerSecond = 1'000'000'000;

inline google::protobuf::Timestamp to_timestamp(std::int64_t utc_ns) {
    google::protobuf::Timestamp out;
    const std::int64_t nanoseconds = utc_ns % kNanosecondsPerSecond;
    const std::int64_t borrow = nanoseconds < 0 ? 1 : 0;
    out.set_seconds(utc_ns / kNanosecondsPerSecond - borrow);
    out.set_nanos(static_cast<std::int32_t>(nanoseconds + borrow * kNanosecondsPerSecond));
    return out;
}

inline std::int64_t to_utc_ns(const google::protobuf::Timestamp& time) {
    constexpr std::int64_t kMaxSeconds = 9'223'372'030;
    return std::clamp(time.seconds(), -kMaxSeconds, kMaxSeconds) * kNanosecondsPerSecond + time.nanos();
}

inline google::protobuf::Duration to_duration(std::chrono::nanoseconds duration) {
    google::protobuf::Duration out;
    out.set_seconds(duration.count() / kNanosecondsPerSecond);
    out.set_nanos(static_cast<std::int32_t>(duration.count() % kNanosecondsPerSecond));
    return out;
}

// Rounded to nanoseconds; 0 for a NaN.
inline google::protobuf::Duration duration_from_s(double seconds) {
    constexpr double kMaxSeconds = 9.2e9;
    if (std::isnan(seconds)) seconds = 0;
    return to_duration(std::chrono::nanoseconds(std::llround(std::clamp(seconds, -kMaxSeconds, kMaxSeconds) *
                                                             static_cast<double>(kNanosecondsPerSecond))));
}

inline double to_seconds(const google::protobuf::Duration& duration) {
    return static_cast<double>(duration.seconds()) + 1e-9 * duration.nanos();
}

// Rounded up, so that a short duration does not become 0.
inline std::chrono::milliseconds to_milliseconds(const google::protobuf::Duration& duration) {
    constexpr std::int64_t kMaxSeconds = 9'000'000'000'000;
    return std::chrono::seconds(std::clamp(duration.seconds(), -kMaxSeconds, kMaxSeconds)) +
           std::chrono::ceil<std::chrono::milliseconds>(std::chrono::nanoseconds(duration.nanos()));
}

}  // namespace kinevox
