#include "common/background_priority.h"

#ifdef __linux__
#include <sys/resource.h>
#include <sys/syscall.h>
#include <unistd.h>
#endif

#include <algorithm>
#include <thread>

namespace kinevox {
namespace {

#ifdef __linux__
id_t this_thread() {
    return static_cast<id_t>(syscall(SYS_gettid));
}
#endif

}  // namespace

void lower_this_threads_priority() {
#ifdef __linux__
    setpriority(PRIO_PROCESS, this_thread(), 10);
#endif
}

void lower_this_threads_priority_by([[maybe_unused]] int levels) {
#ifdef __linux__
    setpriority(PRIO_PROCESS, this_thread(), getpriority(PRIO_PROCESS, this_thread()) + levels);
#endif
}

void with_nicer_threads([[maybe_unused]] int levels, const std::function<void()>& work) {
#ifdef __linux__
    // A thread of its own: what was given up here could not be taken back without privileges.
    std::thread([&] {
        const int now = getpriority(PRIO_PROCESS, this_thread());
        setpriority(PRIO_PROCESS, this_thread(), std::max(now, std::min(now + levels, 0)));
        work();
    }).join();
#else
    work();
#endif
}

}  // namespace kinevox
