// Strict reading of TOML: every key has a type, a range and a default or is required; anything else in the
// file is an error. Used by the calibration, session and configuration readers. toml++ itself stays in
// toml_reader.cc, since it is slow to compile.
//
// A reader asks for all its keys without looking at errors in between and calls finish() at the end, which
// returns the first error as one line
//     FILE:LINE: key 'TABLE.KEY' is WHAT, expected WHAT; REMEDY
// After an error the values returned are the defaults and must not be used.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <limits>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace kinevox {

class TomlDocument;

// Numbers from min to max, both allowed. Infinities and NaN never are.
struct TomlRange {
    double min = std::numeric_limits<double>::lowest();
    double max = std::numeric_limits<double>::max();
};

// A key of an earlier version, with its tables: "server.certificate" and "server.tls_certificate_file". A
// file that has it gets an error that names the new one.
struct RenamedKey {
    std::string_view before, now;
};

// One table of a document; valid as long as the document. Copies mean the same table.
class TomlTable {
  public:
    // Required values.
    double number(std::string_view key, TomlRange range = {}) const;
    std::int64_t integer(std::string_view key, std::int64_t min, std::int64_t max) const;
    std::string text(std::string_view key) const;
    // Between min_count and max_count numbers.
    std::vector<double> numbers(std::string_view key, std::size_t min_count, std::size_t max_count,
                                TomlRange range = {}) const;
    // rows x columns numbers, row after row, from an array of arrays.
    std::vector<double> matrix(std::string_view key, std::size_t rows, std::size_t columns) const;
    // The same with between min_rows and max_rows rows.
    std::vector<double> rows(std::string_view key, std::size_t min_rows, std::size_t max_rows,
                             std::size_t columns) const;

    // Values with a default.
    double number_or(std::string_view key, double fallback, TomlRange range = {}) const;
    std::int64_t integer_or(std::string_view key, std::int64_t fallback, std::int64_t min,
                            std::int64_t max) const;
    std::string text_or(std::string_view key, std::string fallback) const;
    bool boolean_or(std::string_view key, bool fallback) const;
    // An array of texts, empty if the key is missing.
    std::vector<std::string> texts_or_empty(std::string_view key) const;
    // One of `allowed`, or its index.
    std::string choice_or(std::string_view key, std::string fallback,
                          std::span<const std::string_view> allowed) const;
    std::size_t choice_index_or(std::string_view key, std::size_t fallback,
                                std::span<const std::string_view> allowed) const;

    // Tables. table_or_empty: a missing table is one without keys. tables: [[key]], none if it is missing.
    TomlTable table_or_empty(std::string_view key) const;
    std::vector<TomlTable> tables(std::string_view key) const;

    bool has(std::string_view key) const;
    // In the order of the file.
    std::vector<std::string> keys() const;
    // Accepts a key with any value.
    void ignore(std::string_view key) const;

    // Records an error of the reader's own about a key: "FILE:LINE: key 'KEY' WHAT". The first one counts.
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
    // InvalidArgument with FILE:LINE:COLUMN and the parser's message if the text is no TOML.
    // `renamed` must outlive the document.
    static absl::StatusOr<std::unique_ptr<TomlDocument>> parse(std::string_view text,
                                                               std::string_view name_for_errors,
                                                               std::span<const RenamedKey> renamed = {});
    ~TomlDocument();

    TomlTable root() const;

    // A renamed key, else the first error, else an unknown key in any table that was read: InvalidArgument,
    // or the code that was passed to fail().
    absl::Status finish() const;

  private:
    friend class TomlTable;
    struct State;
    explicit TomlDocument(std::unique_ptr<State> state);
    std::unique_ptr<State> state_;
};

// A TOML basic string with its quotes and escapes; a double such that reading returns the same bits.
std::string toml_quoted(std::string_view text);
std::string toml_number(double value);

// Internal, for toml_reader.cc: hides characters beyond ASCII from toml++ 3.3, which has undefined behaviour
// for some of them outside strings (is_non_ascii_horizontal_whitespace() ends in __builtin_unreachable() for
// U+00A1 to U+0499 and others). Private use characters of plane 15 are safe, so they replace the others while
// it parses. This is UTF-8 in which U+0080 to U+FEFF have become U+F0080 to U+FFEFF, character for character,
// so that lines and columns stay; a byte order mark at the start remains. What is no valid UTF-8 is left for
// the parser to refuse.
std::string shielded(std::string_view utf8);

// The reverse.
std::string unshielded(std::string_view utf8);

}  // namespace kinevox
