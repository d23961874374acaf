// A subcommand, such as `kinevox status` or `kinevox poses list`.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>

#include "client/cli/verbs.h"

namespace kinevox::cli {

// Adds it to the app or to a group; when it is parsed, `act` is what runs, with `options` as parsed.
template <class Options>
CLI::App* add_action(CLI::App& parent, GlobalOptions& global, Run& run,
                     const std::shared_ptr<Options>& options, const char* name, const char* help,
                     absl::Status (*act)(const GlobalOptions&, const Options&)) {
    CLI::App* action = parent.add_subcommand(name, help);
    action->callback(
        [&global, &run, options, act] { run = [&global, options, act] { return act(global, *options); }; });
    return action;
}

}  // namespace kinevox::cli
