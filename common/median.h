// Median and other quantiles of values.
#pragma once

#include <algorithm>
#include <cmath>
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

// The value whose rank is nearest to `fraction` of the way from the least (0) to the greatest (1). Reorders
// them; at least one is required.
template <class T>
T quantile_of(std::vector<T>& values, double fraction) {
    const auto at = values.begin() + std::lround(fraction * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), at, values.end());
    return *at;
}

}  // namespace kinevox
