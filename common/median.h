// Median of a range.
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace kinevox {

// The upper median of an even number of values. Reorders them; at least one is required.
template <class T>
T median_of(std::vector<T>& values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

}  // namespace kinevox
