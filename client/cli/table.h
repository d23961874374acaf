// Tables of text with a header line, columns as wide as their widest cell.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace kinevox::cli {

class Table {
  public:
    // A header that begins with '>' aligns its column to the right.
    explicit Table(const std::vector<std::string>& headers);
    void add(std::vector<std::string> cells);
    std::string text() const;  // lines without blanks at their ends; no newline at the end

  private:
    std::vector<bool> right_;
    std::vector<std::vector<std::string>> rows_;
};

// "1 frame", "2 frames".
std::string count_of(std::uint64_t count, const std::string& noun);

}  // namespace kinevox::cli
