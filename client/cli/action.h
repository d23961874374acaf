// A verb of a verb, such as `kinevox poses list`.
#pragma once

#include <CLI/CLI.hpp>
#include <memory>

#include "client/cli/verbs.h"

namespace kinevox::cli {

// Adds it with the options that all verbs take; when it is called, `act` is what runs, with `options` as
// parsed.
template <class Options>
CLI::App* add_action(CLI::App& verb, Common& common, Run& run, const std::shared_ptr<Options>& options,
                     const char* name, const char* help, absl::Status (*act)(const Common&, const Options&)) {
    CLI::App* action = verb.add_subcommand(name, help);
    add_common_options(*action, common);
    action->callback(
        [&common, &run, options, act] { run = [&common, options, act] { return act(common, *options); }; });
    return action;
}

}  // namespace kinevox::cli
