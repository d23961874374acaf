// Strict reader of the tables that `kinevox process` writes.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <limits>
#include <span>
#include <string>
#include <vector>

namespace kinevox {

struct CsvTable {
    std::string file;  // for messages
    std::size_t columns = 0;
    std::vector<double> cells;       // row after row; NaN where empty
    std::vector<std::size_t> lines;  // per row its line in the file, from 1
    std::size_t rows() const { return columns ? cells.size() / columns : 0; }
    double at(std::size_t row, std::size_t column) const { return cells[row * columns + column]; }
};

// A header of exactly `columns`, then rows of numbers or empty cells. InvalidArgument names file, line and
// column.
absl::StatusOr<CsvTable> read_csv_table(const std::filesystem::path& file,
                                        std::span<const std::string> columns);

}  // namespace kinevox
