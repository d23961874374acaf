// Places of cameras from a person who walks: what `extrinsics --person` does.
#pragma once

#include <absl/status/status.h>

#include <string>

namespace kinevox::calibrate {

struct PersonArguments {
    std::string session, lenses, out;
    double height_m = 0;  // of the subject; 0: not known
    int moments = 150;
    bool quiet = false;
};

absl::Status person_extrinsics(const PersonArguments& arguments);

}  // namespace kinevox::calibrate
