// A smooth curve through (time, value) keys that never overshoots them: monotone cubic Hermite after Fritsch
// & Carlson. Constant before the first and after the last key.
#pragma once

#include <initializer_list>
#include <utility>
#include <vector>

namespace kinevox::studio {

class KeyCurve {
  public:
    KeyCurve(std::initializer_list<std::pair<double, double>> keys) : KeyCurve(std::vector(keys)) {}
    explicit KeyCurve(std::vector<std::pair<double, double>> keys)
        : keys_(std::move(keys)), slope_(keys_.size(), 0) {
        for (std::size_t i = 1; i + 1 < keys_.size(); ++i) {
            const double before = rate(i - 1), after = rate(i);
            if (before * after > 0) slope_[i] = 2 * before * after / (before + after);
        }
    }
    double operator()(double t) const {
        if (t <= keys_.front().first) return keys_.front().second;
        if (t >= keys_.back().first) return keys_.back().second;
        std::size_t i = 0;
        while (keys_[i + 1].first <= t) ++i;
        const double h = keys_[i + 1].first - keys_[i].first, s = (t - keys_[i].first) / h;
        const double a = keys_[i].second, b = keys_[i + 1].second;
        return a + (b - a) * s * s * (3 - 2 * s) +
               h * s * (1 - s) * ((1 - s) * slope_[i] - s * slope_[i + 1]);
    }

  private:
    double rate(std::size_t i) const {
        return (keys_[i + 1].second - keys_[i].second) / (keys_[i + 1].first - keys_[i].first);
    }
    std::vector<std::pair<double, double>> keys_;
    std::vector<double> slope_;
};

}  // namespace kinevox::studio
