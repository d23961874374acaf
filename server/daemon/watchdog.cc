#include "server/daemon/watchdog.h"

#include <algorithm>

namespace kinevox {

Watchdog::Word Watchdog::look(std::chrono::nanoseconds in_hand) {
    if (interval_ <= std::chrono::nanoseconds::zero()) return Word::kNone;
    const bool was_hung = hung_;
    hung_ = in_hand >= max_in_hand();
    if (!hung_) return Word::kAlive;
    return was_hung ? Word::kNone : Word::kHung;
}

std::chrono::nanoseconds Watchdog::period() const {
    const std::chrono::nanoseconds second = std::chrono::seconds(1);
    return interval_ > std::chrono::nanoseconds::zero() ? std::min(second, interval_ / 4) : second;
}

}  // namespace kinevox
