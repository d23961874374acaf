#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace kinevox {

// Of an even number of values the upper one of the middle two. Reorders them; there must be one at least.
template <class T>
T median_of(std::vector<T>& values) {
    const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
    std::nth_element(values.begin(), middle, values.end());
    return *middle;
}

}  // namespace kinevox
