// Strict reading of TOML: every key has a type, a range and a default or is required; anything else in the
// file is an error. Used by the calibration, session and configuration readers. toml++ itself stays in
// toml_reader.cc, since it is slow to compile.
//
// A reader asks for all its keys without looking at errors in between and asks finish() at the end: it tells
// the first thing that is wrong as one line
//     FILE:LINE: key 'TABLE.KEY' is WHAT, expected WHAT; REMEDY
// After an error the values returned are the defaults and must not be used.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

namespace kinevox {

class TomlDocument;

// Numbers from lowest to highest, both allowed. Infinities and NaN never are.
struct TomlRange {
    double lowest = std::numeric_limits<double>::lowest();
    double highest = std::numeric_limits<double>::max();
};

// One table of a document; valid as long as the document. Copies mean the same table.
class TomlTable {
  public:
    // Required values.
    double number(std::string_view key, TomlRange range = {}) const;
    std::int64_t integer(std::string_view key, std::int64_t lowest, std::int64_t highest) const;
    std::string text(std::string_view key) const;
    // Numbers of which there may be between min_count and max_count.
    std::vector<double> numbers(std::string_view key, std::size_t min_count, std::size_t max_count,
                                TomlRange range = {}) const;
    // rows x columns numbers, row after row, from an array of arrays.
    std::vector<double> matrix(std::string_view key, std::size_t rows, std::size_t columns) const;

    // Values with a default.
    double number_or(std::string_view key, double fallback, TomlRange range = {}) const;
    std::int64_t integer_or(std::string_view key, std::int64_t fallback, std::int64_t lowest,
                            std::int64_t highest) const;
    std::string text_or(std::string_view key, std::string fallback) const;
    bool boolean_or(std::string_view key, bool fallback) const;
    // One of `allowed`.
    std::string choice_or(std::string_view key, std::string fallback,
                          const std::vector<std::string_view>& allowed) const;

    // Tables. table_or_empty: as if it stood there without keys. tables: [[key]], none if it is missing.
    TomlTable table_or_empty(std::string_view key) const;
    std::vector<TomlTable> tables(std::string_view key) const;

    bool has(std::string_view key) const;
    // In the order of the file.
    std::vector<std::string> keys() const;
    // Accepts a key whatever it holds.
    void ignore(std::string_view key) const;

    // Notes an error of the reader's own about a key: "FILE:LINE: key 'KEY' WHAT". The first one counts.
    void fail(std::string_view key, std::string_view what,
              absl::StatusCode code = absl::StatusCode::kInvalidArgument) const;

  private:
    friend class TomlDocument;
    struct Node;
    explicit TomlTable(Node* node) : node_(node) {}
    const void* find(std::string_view key) const;
    const void* require(std::string_view key) const;
    void wrong(std::string_view key, const void* found, const std::string& expected) const;
    Node* node_;
};

class TomlDocument {
  public:
    // InvalidArgument with FILE:LINE:COLUMN and the parser's words if the text is no TOML.
    static absl::StatusOr<std::unique_ptr<TomlDocument>> parse(std::string_view text,
                                                               std::string_view name_for_errors);
    ~TomlDocument();

    TomlTable root() const;

    // The first error, or else an unknown key in any table that was looked into: InvalidArgument, or the code
    // that fail() was given.
    absl::Status finish() const;

  private:
    friend class TomlTable;
    struct State;
    explicit TomlDocument(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

// A TOML basic string with its quotes and escapes; a double such that reading gives the very same double.
std::string toml_quoted(std::string_view text);
std::string toml_number(double value);

}  // namespace kinevox
