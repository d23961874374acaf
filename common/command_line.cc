#include "common/command_line.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <exception>
#include <numeric>
#include <utility>

#include "common/one_line.h"

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

using Apps = std::vector<const CLI::App*>;  // a command with those above it

std::vector<const CLI::App*> subcommands(const CLI::App& app) {
    return app.get_subcommands([](const CLI::App*) { return true; });
}

const CLI::Option* find_option(const Apps& apps, const std::string& name) {
    for (const CLI::App* app : apps)
        for (const CLI::Option* option : app->get_options())
            if (option->check_name(name)) return option;
    return nullptr;
}

std::vector<std::string> option_names(const Apps& apps) {
    std::vector<std::string> out;
    for (const CLI::App* app : apps)
        for (const CLI::Option* option : app->get_options())
            for (const std::string& name : option->get_lnames()) out.push_back("--" + name);
    return out;
}

// The first word that is neither a known command where one must stand, nor a known option.
std::string first_unknown_word(const CLI::App& root, const std::vector<std::string>& words,
                               const std::vector<std::string>& more_commands) {
    Apps apps{&root};
    std::string path;
    for (std::size_t i = 0; i < words.size() && words[i] != "--"; ++i) {
        const std::string& word = words[i];
        if (word.starts_with("--")) {
            const std::string name = word.substr(0, word.find('='));
            const CLI::Option* const option = find_option(apps, name);
            if (!option) return unknown_word_text("option", name, option_names(apps));
            if (option->get_expected_min() > 0 && name == word) ++i;  // its value
        } else if (const auto subs = subcommands(*apps.front()); !subs.empty() && !word.starts_with('-')) {
            const auto found =
                std::ranges::find_if(subs, [&](const CLI::App* a) { return a->check_name(word); });
            if (found == subs.end()) {
                std::vector<std::string> known;
                for (const CLI::App* sub : subs) known.push_back(sub->get_name());
                if (apps.size() == 1) known.insert(known.end(), more_commands.begin(), more_commands.end());
                return unknown_word_text(path.empty() ? "command" : path + " command", word, known);
            }
            path += (path.empty() ? "" : " ") + word;
            apps.insert(apps.begin(), *found);
        }
    }
    return "";
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

int report_failure(const std::string& name, const std::string& message) {
    if (!message.empty()) fmt::print(stderr, "{}: {}\n", name, one_line(message));
    return 1;
}

std::string unknown_word_text(const std::string& kind, const std::string& word,
                              const std::vector<std::string>& known) {
    const auto meant = closest_word(word, known);
    return fmt::format("unknown {} '{}'{}", kind, word,
                       meant ? fmt::format("; did you mean '{}'?", *meant) : "");
}

std::string parse_error_text(const CLI::App& app, const std::vector<std::string>& words,
                             const CLI::ParseError& error, const std::vector<std::string>& more_commands) {
    std::string text = first_unknown_word(app, words, more_commands);
    if (text.empty()) {
        text = error.what();
        text = text.substr(0, text.find('\n'));
    }
    return fmt::format("{}{} see {} --help", text, text.ends_with('?') ? "" : ";", app.get_name());
}

void add_exit_status_help(CLI::App& app) {
    if (app.get_footer().empty()) app.footer(kExitStatusHelp);
    for (CLI::App* sub : app.get_subcommands([](CLI::App*) { return true; })) add_exit_status_help(*sub);
}

std::optional<int> parse_command_line(CLI::App& app, int argc, const char* const* argv) {
    add_exit_status_help(app);
    try {
        app.parse(argc, argv);
        return std::nullopt;
    } catch (const CLI::ParseError& error) {
        if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
        return report_failure(app.get_name(),
                              parse_error_text(app, {argv + std::min(argc, 1), argv + argc}, error));
    }
}

int tool_main(CLI::App& app, int argc, const char* const* argv, const std::function<absl::Status()>& run) {
    try {
        if (const auto ended = parse_command_line(app, argc, argv)) return *ended;
        const absl::Status status = run();
        return status.ok() ? 0 : report_failure(app.get_name(), std::string(status.message()));
    } catch (const std::exception& error) {
        return report_failure(app.get_name(), error.what());
    }
}

}  // namespace kinevox
