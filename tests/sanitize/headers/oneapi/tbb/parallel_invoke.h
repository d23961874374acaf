// Replaces oneTBB's header of this name, like parallel_for.h.
#pragma once

#include <oneapi/tbb/parallel_for.h>

#include <functional>

namespace tbb {

template <class... F>
void parallel_invoke(const F&... bodies) {
    const std::function<void()> all[] = {std::cref(bodies)...};
    kinevox::sanitize::share_out(sizeof...(F), [&](std::size_t n) { all[n](); });
}

}  // namespace tbb
