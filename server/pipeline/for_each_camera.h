#pragma once

#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/partitioner.h>

#include <cstddef>

namespace kinevox {

// body(0) .. body(count - 1), cameras in parallel; idle workers steal work that a camera's stage splits
// further.
template <class F>
void for_each_camera(std::size_t count, F body) {
    oneapi::tbb::parallel_for(std::size_t{0}, count, body, oneapi::tbb::simple_partitioner());
}

}  // namespace kinevox
