// How long a test waits for what must come soon: under sanitizers everything takes many times as long.
#pragma once

namespace kinevox::testing {

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr int kTimesSlower = 20;
#else
inline constexpr int kTimesSlower = 1;
#endif

// A duration that holds in a build for users, in this one.
template <class Duration>
constexpr Duration patient(Duration limit) {
    return limit * kTimesSlower;
}

}  // namespace kinevox::testing
