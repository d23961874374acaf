#include "common/background_priority.h"

#include <gtest/gtest.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>

#include <thread>

namespace kinevox {
namespace {

id_t this_thread() {
    return static_cast<id_t>(syscall(SYS_gettid));
}

int niceness() {
    return getpriority(PRIO_PROCESS, this_thread());
}

// Of a thread that is started within with_nicer_threads, by one that is itself as nice as `caller` says.
int inherited(int caller, int levels, bool& allowed) {
    int seen = 1000;
    std::thread([&] {
        allowed = setpriority(PRIO_PROCESS, this_thread(), caller) == 0;
        if (!allowed) return;
        with_nicer_threads(levels, [&] { std::thread([&] { seen = niceness(); }).join(); });
        EXPECT_EQ(niceness(), caller) << "the caller's own";
    }).join();
    return seen;
}

TEST(BackgroundPriority, LowersThreadsBelowTheirCallerOnly) {
    struct Case {
        int caller, levels, want;
    };
    for (const Case& c : {Case{-15, 10, -5}, Case{-5, 10, 0}, Case{0, 10, 0}, Case{7, 10, 7}}) {
        bool allowed = false;
        const int seen = inherited(c.caller, c.levels, allowed);
        EXPECT_TRUE(allowed || c.caller < niceness()) << "a priority is given up without privileges";
        EXPECT_TRUE(!allowed || seen == c.want) << c.caller << ": " << seen;
    }
}

}  // namespace
}  // namespace kinevox
