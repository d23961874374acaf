// The verbs of `kinevox calibrate`, on files without a daemon. Each declares its options and, once they are
// parsed, is run by the main program.
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

std::vector<Verb> file_verbs(CLI::App& app);     // import, export
std::vector<Verb> lens_verbs(CLI::App& app);     // intrinsics
std::vector<Verb> places_verbs(CLI::App& app);   // extrinsics
std::vector<Verb> floor_verbs(CLI::App& app);    // floor
std::vector<Verb> session_verbs(CLI::App& app);  // refine, check

}  // namespace kinevox::calibrate
