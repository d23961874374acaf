// In the place of oneTBB's header of this name, as parallel_for.h beside it.
#pragma once

#include <future>

#include <oneapi/tbb/partitioner.h>   // the namespaces' names

namespace tbb {

template <class... F>
void parallel_invoke(const F&... bodies) {
    std::future<void> all[] = {std::async(std::launch::async, [&] { bodies(); })...};
    for (auto& one : all) one.get();
}

}  // namespace tbb
