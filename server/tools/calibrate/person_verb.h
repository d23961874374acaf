// Extrinsics from a walking person: `extrinsics --person`.
#pragma once

#include <absl/status/status.h>

#include <string>

#include "server/tools/calibrate/certificate_files.h"

namespace kinevox::calibrate {

struct PersonArguments {
    std::string session, intrinsics;
    double stature_m = 0;  // of the subject; 0: unknown
    int frame_sets = 150;
    Output output;
};

absl::Status person_extrinsics(const PersonArguments& arguments);

}  // namespace kinevox::calibrate
