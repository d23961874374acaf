#include "common/toml_reader.h"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cmath>
#include <list>
#include <optional>
#include <set>

#include "common/one_line.h"

namespace kinevox {
namespace {

// What a value is, for messages: `"text"`, `12`, `an array of 3`.
std::string describe(const toml::node& node) {
    if (const auto* text = node.as_string()) {
        const std::string& value = text->get();
        return value.size() > 60 ? fmt::format("the text \"{}...\"", value.substr(0, 60))
                                 : fmt::format("the text \"{}\"", value);
    }
    if (const auto* integer = node.as_integer()) return fmt::format("{}", integer->get());
    if (const auto* number = node.as_floating_point()) return fmt::format("{}", number->get());
    if (const auto* boolean = node.as_boolean()) return boolean->get() ? "true" : "false";
    if (const auto* array = node.as_array()) return fmt::format("an array of {}", array->size());
    if (node.is_table()) return "a table";
    return "a date or time";
}

std::optional<double> as_number(const toml::node& node) {
    if (const auto* integer = node.as_integer()) return static_cast<double>(integer->get());
    if (const auto* number = node.as_floating_point()) return number->get();
    return std::nullopt;
}

bool within(double value, TomlRange range) {
    return std::isfinite(value) && value >= range.min && value <= range.max;
}

std::string describe(TomlRange range) {
    const bool low = range.min > std::numeric_limits<double>::lowest();
    const bool high = range.max < std::numeric_limits<double>::max();
    if (low && high) return fmt::format("a number from {} to {}", range.min, range.max);
    if (low) return fmt::format("a finite number, at least {}", range.min);
    if (high) return fmt::format("a finite number, at most {}", range.max);
    return "a finite number";
}

// Restores the file's characters in keys and texts below `node`; their positions in the file stay known.
void unshield(toml::node& node) {
    if (auto* text = node.as_string()) {
        text->get() = unshielded(text->get());
    } else if (auto* array = node.as_array()) {
        for (toml::node& element : *array) unshield(element);
    } else if (auto* table = node.as_table()) {
        toml::table renamed;
        for (auto&& [key, value] : *table) {
            unshield(value);
            toml::key own(unshielded(key.str()), toml::source_region(key.source()));
            value.visit([&](auto& typed) { renamed.insert_or_assign(std::move(own), std::move(typed)); });
        }
        table->clear();
        for (auto&& [key, value] : renamed)
            value.visit([&, &key = key](auto& typed) { table->insert_or_assign(key, std::move(typed)); });
    }
}

}  // namespace

struct TomlTable::Node {
    TomlDocument::State* state = nullptr;
    const toml::table* table = nullptr;
    std::string path;                          // "server." or empty for the root
    std::set<std::string, std::less<>> asked;  // keys that the reader knows
};

struct TomlDocument::State {
    std::string name;
    toml::table root;
    std::list<TomlTable::Node> nodes;  // list: TomlTable points into it
    std::string first_error;
    absl::StatusCode first_code = absl::StatusCode::kInvalidArgument;
    bool first_error_is_a_missing_key = false;
    toml::table empty;
    std::span<const RenamedKey> renamed;

    TomlTable::Node* add(const toml::table* table, std::string path) {
        nodes.push_back({this, table, std::move(path), {}});
        return &nodes.back();
    }
    void note(const toml::source_region& where, const std::string& what, bool missing_key = false) {
        if (!first_error.empty()) return;
        first_error = where.begin ? fmt::format("{}:{}: {}", name, where.begin.line, what)
                                  : fmt::format("{}: {}", name, what);
        first_error_is_a_missing_key = missing_key;
    }
};

const void* TomlTable::find(std::string_view key) const {
    node_->asked.emplace(key);
    return static_cast<const void*>(node_->table->get(key));
}

const void* TomlTable::require(std::string_view key) const {
    const void* found = find(key);
    if (!found)
        node_->state->note(node_->table->source(),
                           fmt::format("key '{}{}' is missing; add it", node_->path, key), true);
    return found;
}

void TomlTable::wrong(std::string_view key, const void* found, const std::string& expected) const {
    const auto& node = *static_cast<const toml::node*>(found);
    node_->state->note(node.source(), fmt::format("key '{}{}' is {}, expected {}; correct it", node_->path,
                                                  key, describe(node), expected));
}

double TomlTable::number(std::string_view key, TomlRange range) const {
    return require(key) ? number_or(key, 0, range) : 0;
}

std::int64_t TomlTable::integer(std::string_view key, std::int64_t min, std::int64_t max) const {
    return require(key) ? integer_or(key, min, min, max) : min;
}

std::string TomlTable::text(std::string_view key) const {
    return require(key) ? text_or(key, "") : "";
}

std::vector<double> TomlTable::numbers(std::string_view key, std::size_t min_count, std::size_t max_count,
                                       TomlRange range) const {
    std::vector<double> values(min_count, 0.0);
    const void* found = require(key);
    if (!found) return values;
    const std::string count =
        min_count == max_count ? fmt::format("{}", min_count) : fmt::format("{} to {}", min_count, max_count);
    const auto* array = static_cast<const toml::node*>(found)->as_array();
    if (!array || array->size() < min_count || array->size() > max_count) {
        wrong(key, found, fmt::format("an array of {} numbers", count));
        return values;
    }
    values.clear();
    for (const toml::node& element : *array) {
        const std::optional<double> value = as_number(element);
        if (!value || !within(*value, range)) {
            node_->state->note(element.source(),
                               fmt::format("key '{}{}' holds {}, expected {} numbers, each {}; correct it",
                                           node_->path, key, describe(element), count, describe(range)));
            return std::vector<double>(min_count, 0.0);
        }
        values.push_back(*value);
    }
    return values;
}

std::vector<double> TomlTable::matrix(std::string_view key, std::size_t rows, std::size_t columns) const {
    return this->rows(key, rows, rows, columns);
}

std::vector<double> TomlTable::rows(std::string_view key, std::size_t min_rows, std::size_t max_rows,
                                    std::size_t columns) const {
    const std::vector<double> zeros(min_rows * columns, 0.0);
    const void* found = require(key);
    if (!found) return zeros;
    const std::string count =
        min_rows == max_rows ? fmt::format("{}", min_rows) : fmt::format("{} to {}", min_rows, max_rows);
    const std::string expected = fmt::format("{} rows of {} finite numbers", count, columns);
    const auto* array = static_cast<const toml::node*>(found)->as_array();
    if (!array || array->size() < min_rows || array->size() > max_rows) {
        wrong(key, found, expected);
        return zeros;
    }
    std::vector<double> values;
    for (const toml::node& row_node : *array) {
        const toml::array* row = row_node.as_array();
        if (!row || row->size() != columns) {
            wrong(key, &row_node, expected);
            return zeros;
        }
        for (const toml::node& element : *row) {
            const std::optional<double> value = as_number(element);
            if (!value || !std::isfinite(*value)) {
                node_->state->note(element.source(),
                                   fmt::format("key '{}{}' holds {}, expected {}; correct it", node_->path,
                                               key, describe(element), expected));
                return zeros;
            }
            values.push_back(*value);
        }
    }
    return values;
}

double TomlTable::number_or(std::string_view key, double fallback, TomlRange range) const {
    const void* found = find(key);
    if (!found) return fallback;
    const std::optional<double> value = as_number(*static_cast<const toml::node*>(found));
    if (value && within(*value, range)) return *value;
    wrong(key, found, describe(range));
    return fallback;
}

std::int64_t TomlTable::integer_or(std::string_view key, std::int64_t fallback, std::int64_t min,
                                   std::int64_t max) const {
    const void* found = find(key);
    if (!found) return fallback;
    const auto* integer = static_cast<const toml::node*>(found)->as_integer();
    if (integer && integer->get() >= min && integer->get() <= max) return integer->get();
    wrong(key, found, fmt::format("a whole number from {} to {}", min, max));
    return fallback;
}

std::string TomlTable::text_or(std::string_view key, std::string fallback) const {
    const void* found = find(key);
    if (!found) return fallback;
    if (const auto* text = static_cast<const toml::node*>(found)->as_string()) return text->get();
    wrong(key, found, "a text in quotes");
    return fallback;
}

std::vector<std::string> TomlTable::texts_or_empty(std::string_view key) const {
    const void* found = find(key);
    if (!found) return {};
    std::vector<std::string> texts;
    const auto* array = static_cast<const toml::node*>(found)->as_array();
    if (array)
        for (const toml::node& element : *array)
            if (const auto* text = element.as_string()) texts.push_back(text->get());
    if (array && texts.size() == array->size()) return texts;
    wrong(key, found, "an array of texts in quotes");
    return {};
}

bool TomlTable::boolean_or(std::string_view key, bool fallback) const {
    const void* found = find(key);
    if (!found) return fallback;
    if (const auto* boolean = static_cast<const toml::node*>(found)->as_boolean()) return boolean->get();
    wrong(key, found, "true or false");
    return fallback;
}

std::string TomlTable::choice_or(std::string_view key, std::string fallback,
                                 std::span<const std::string_view> allowed) const {
    const std::size_t index = choice_index_or(key, allowed.size(), allowed);
    return index < allowed.size() ? std::string(allowed[index]) : fallback;
}

std::size_t TomlTable::choice_index_or(std::string_view key, std::size_t fallback,
                                       std::span<const std::string_view> allowed) const {
    const void* found = find(key);
    if (!found) return fallback;
    const auto* text = static_cast<const toml::node*>(found)->as_string();
    if (text)
        if (const auto same = std::ranges::find(allowed, text->get()); same != allowed.end())
            return static_cast<std::size_t>(same - allowed.begin());
    wrong(key, found, fmt::format("one of \"{}\"", fmt::join(allowed, "\", \"")));
    return fallback;
}

TomlTable TomlTable::table_or_empty(std::string_view key) const {
    const void* found = find(key);
    const toml::table* table = found ? static_cast<const toml::node*>(found)->as_table() : nullptr;
    if (found && !table) wrong(key, found, fmt::format("a table [{}{}]", node_->path, key));
    return TomlTable(
        node_->state->add(table ? table : &node_->state->empty, fmt::format("{}{}.", node_->path, key)));
}

std::vector<TomlTable> TomlTable::tables(std::string_view key) const {
    std::vector<TomlTable> out;
    const void* found = find(key);
    if (!found) return out;
    const auto* array = static_cast<const toml::node*>(found)->as_array();
    if (!array) {
        wrong(key, found, fmt::format("tables, each headed [[{}{}]]", node_->path, key));
        return out;
    }
    for (const toml::node& element : *array) {
        const toml::table* table = element.as_table();
        if (!table) {
            wrong(key, &element, fmt::format("a table headed [[{}{}]]", node_->path, key));
            return {};
        }
        out.push_back(TomlTable(node_->state->add(table, fmt::format("{}{}.", node_->path, key))));
    }
    return out;
}

bool TomlTable::has(std::string_view key) const {
    return node_->table->get(key) != nullptr;
}

std::vector<std::string> TomlTable::keys() const {
    std::vector<std::pair<toml::source_position, std::string>> found;
    for (const auto& [key, node] : *node_->table)
        found.emplace_back(key.source().begin, std::string(key.str()));
    std::sort(found.begin(), found.end());
    std::vector<std::string> out;
    for (auto& [where, key] : found) out.push_back(std::move(key));
    return out;
}

void TomlTable::ignore(std::string_view key) const {
    node_->asked.emplace(key);
}

void TomlTable::fail(std::string_view key, std::string_view what, absl::StatusCode code) const {
    const toml::node* found = node_->table->get(key);
    if (node_->state->first_error.empty()) node_->state->first_code = code;
    node_->state->note(found ? found->source() : node_->table->source(),
                       fmt::format("key '{}{}' {}", node_->path, key, what));
}

TomlDocument::TomlDocument(std::unique_ptr<State> state) : state_(std::move(state)) {}
TomlDocument::~TomlDocument() = default;

absl::StatusOr<std::unique_ptr<TomlDocument>> TomlDocument::parse(std::string_view text,
                                                                  std::string_view name_for_errors,
                                                                  std::span<const RenamedKey> renamed) {
    auto state = std::make_unique<State>();
    state->name = name_for_errors;
    state->renamed = renamed;
    try {
        state->root = toml::parse(shielded(text), name_for_errors);
        unshield(state->root);
    } catch (const toml::parse_error& error) {
        const toml::source_position where = error.source().begin;
        const std::string what = unshielded(error.description());
        const bool beyond_ascii =
            std::ranges::any_of(what, [](char c) { return static_cast<unsigned char>(c) >= 0x80; });
        return absl::InvalidArgumentError(one_line(
            fmt::format("{}:{}:{}: is no valid TOML: {}; {}", name_for_errors, where.line, where.column, what,
                        beyond_ascii ? "put characters beyond ASCII into quotes" : "correct the line")));
    }
    state->add(&state->root, "");
    return std::unique_ptr<TomlDocument>(new TomlDocument(std::move(state)));
}

TomlTable TomlDocument::root() const {
    return TomlTable(&state_->nodes.front());
}

absl::Status TomlDocument::finish() const {
    const auto unknown = [&](const auto& report) -> absl::Status {
        for (const TomlTable::Node& node : state_->nodes)
            for (const std::string& key : TomlTable(const_cast<TomlTable::Node*>(&node)).keys()) {
                if (node.asked.contains(key)) continue;
                const auto line = node.table->find(key)->first.source().begin.line;
                if (absl::Status status = report(node, key, line); !status.ok()) return status;
            }
        return absl::OkStatus();
    };
    // A renamed key often makes another error, too: that the new key is missing.
    absl::Status renamed = unknown([&](const TomlTable::Node& node, const std::string& key,
                                       auto line) -> absl::Status {
        for (const RenamedKey& each : state_->renamed)
            if (each.before == node.path + key)
                return absl::InvalidArgumentError(one_line(fmt::format(
                    "{}:{}: key '{}' is now '{}'; rename it", state_->name, line, each.before, each.now)));
        return absl::OkStatus();
    });
    if (!renamed.ok()) return renamed;
    // So does a misspelt one.
    if (state_->first_error.empty() || state_->first_error_is_a_missing_key) {
        absl::Status misspelt = unknown([&](const TomlTable::Node& node, const std::string& key, auto line) {
            return absl::InvalidArgumentError(
                one_line(fmt::format("{}:{}: key '{}{}' is unknown, expected one of {}; correct or remove it",
                                     state_->name, line, node.path, key, fmt::join(node.asked, ", "))));
        });
        if (!misspelt.ok()) return misspelt;
    }
    if (!state_->first_error.empty()) return absl::Status(state_->first_code, one_line(state_->first_error));
    return absl::OkStatus();
}

std::string toml_quoted(std::string_view text) {
    std::string out = "\"";
    for (const char c : text) {
        if (c == '"' || c == '\\') {
            out += '\\';
            out += c;
        } else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) {
            out += fmt::format("\\u{:04X}", static_cast<unsigned>(c));
        } else {
            out += c;
        }
    }
    return out + '"';
}

std::string toml_number(double value) {
    std::string text = fmt::format("{}", value);  // fmt writes the shortest text that reads back the same
    const bool integral = text.find_first_of(".eEn") == std::string::npos;  // n: nan, inf
    return integral ? text + ".0" : text;
}

}  // namespace kinevox
