// What a work of minutes asks and tells while it goes on.
#pragma once

#include <atomic>
#include <functional>

namespace kinevox {

struct LongWork {
    const std::atomic<bool>& stop;  // from then on it ends with Cancelled
    std::function<void(double)> progress =
        {};  // the share that is done, 0 to 1, growing; often, on the work's thread

    void tell(double share) const {
        if (progress) progress(share);
    }
    // A part of it, as long as this share: its own 0 to 1 is `from` to `to` here. Not longer alive than this.
    LongWork part(double from, double to) const {
        return {stop, [this, from, to](double share) { tell(from + share * (to - from)); }};
    }
};

}  // namespace kinevox
