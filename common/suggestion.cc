#include "common/suggestion.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace kinevox {
namespace {

// Levenshtein's distance; neighbours swapped count as one.
int edit_distance(const std::string& a, const std::string& b) {
    std::vector<int> before(b.size() + 1), row(b.size() + 1), next(b.size() + 1);
    std::iota(row.begin(), row.end(), 0);
    for (std::size_t i = 1; i <= a.size(); ++i) {
        next[0] = static_cast<int>(i);
        for (std::size_t j = 1; j <= b.size(); ++j) {
            next[j] = std::min({row[j] + 1, next[j - 1] + 1, row[j - 1] + (a[i - 1] != b[j - 1])});
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1])
                next[j] = std::min(next[j], before[j - 2] + 1);
        }
        before = std::exchange(row, next);
    }
    return row.back();
}

}  // namespace

std::optional<std::string> closest_word(const std::string& word, const std::vector<std::string>& candidates) {
    std::optional<std::string> best;
    int best_distance = std::min(3, static_cast<int>(word.size() + 1) / 2);
    for (const std::string& candidate : candidates)
        if (const int distance = edit_distance(word, candidate); distance < best_distance) {
            best = candidate;
            best_distance = distance;
        }
    return best;
}

}  // namespace kinevox
