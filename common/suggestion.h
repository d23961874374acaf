// What a mistyped word was probably meant to be.
#pragma once

#include <optional>
#include <string>
#include <vector>

namespace kinevox {

// The candidate with the smallest edit distance, where that is at most 2 and below half the word's length.
std::optional<std::string> closest_word(const std::string& word, const std::vector<std::string>& candidates);

}  // namespace kinevox
