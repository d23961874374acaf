// The commands of `kinevox calibrate` that work on files. Each declares its options; the main program runs
// the parsed one.
#pragma once

#include <absl/status/status.h>

#include <functional>
#include <vector>

namespace CLI {
class App;
}

namespace kinevox::calibrate {

struct Verb {
    CLI::App* app = nullptr;
    std::function<absl::Status()> run;
};

std::vector<Verb> convert_verbs(CLI::App& app);     // convert
std::vector<Verb> intrinsics_verbs(CLI::App& app);  // intrinsics
std::vector<Verb> extrinsics_verbs(CLI::App& app);  // extrinsics
std::vector<Verb> floor_verbs(CLI::App& app);       // floor
std::vector<Verb> session_verbs(CLI::App& app);     // refine, check

}  // namespace kinevox::calibrate
