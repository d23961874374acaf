// How long a test waits for what must come soon: under sanitizers everything takes many times as long.
#pragma once

#include <chrono>
#include <thread>

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

// Whether the condition holds within patient(limit).
template <class Condition>
bool eventually(const Condition& condition, std::chrono::seconds limit = std::chrono::seconds(20)) {
    const auto end = std::chrono::steady_clock::now() + patient(limit);
    while (!condition()) {
        if (std::chrono::steady_clock::now() > end) return false;
        std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    return true;
}

}  // namespace kinevox::testing
