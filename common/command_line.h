// What the project's command lines share: errors of one line, with a suggestion for a mistyped word.
#pragma once

#include <absl/status/status.h>

#include <CLI/CLI.hpp>
#include <functional>
#include <optional>
#include <string>
#include <vector>

namespace kinevox {

// Exit statuses of all programs.
inline constexpr const char* kExitStatusHelp =
    "Exit status: 0 on success, 1 on any error, with one line on standard error.";

// Prints "NAME: MESSAGE" on standard error, where there is a message; returns the exit status 1.
int report_failure(const std::string& name, const std::string& message);

// One line: what is wrong with these words (argv without the program), and what was probably meant.
// `more_commands`: top-level commands that are not subcommands of `app`.
std::string parse_error_text(const CLI::App& app, const std::vector<std::string>& words,
                             const CLI::ParseError& error,
                             const std::vector<std::string>& more_commands = {});

// The candidate with the smallest edit distance, where that is at most 2 and below half the word's length.
std::optional<std::string> closest_word(const std::string& word, const std::vector<std::string>& candidates);

// "unknown command 'recrod'; did you mean 'record'?"
std::string unknown_word_text(const std::string& kind, const std::string& word,
                              const std::vector<std::string>& known);

// Ends the help of the app and its subcommands with kExitStatusHelp, where they have no other footer.
void add_exit_status_help(CLI::App& app);

// Parses the command line, with add_exit_status_help(); the exit status where the program ends with that:
// help, version or an error.
std::optional<int> parse_command_line(CLI::App& app, int argc, const char* const* argv);

// A whole program: parses, runs, reports. An error without a message is one that `run` has reported itself.
int tool_main(CLI::App& app, int argc, const char* const* argv, const std::function<absl::Status()>& run);

}  // namespace kinevox
