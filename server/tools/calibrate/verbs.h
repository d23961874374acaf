// The commands of `kinevox calibrate` that work on files. Each declares its options; the main program runs
// the parsed one.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <functional>
#include <string>
#include <vector>

#include "server/calibration/board/board_clips.h"
#include "server/calibration/board/intrinsics.h"
#include "server/tools/calibrate/certificate_files.h"

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

// Intrinsics from images of a board: shared by the commands intrinsics and extrinsics; in intrinsics_verb.cc.

using BoardDetections = std::vector<std::vector<BoardDetection>>;  // see detect_boards()

// One result per clip. `stride`: step between the images.
absl::StatusOr<std::vector<IntrinsicsResult>> solve_intrinsics(const std::vector<CameraClip>& clips,
                                                               const BoardSpec& board,
                                                               const BoardDetections& detections, int stride,
                                                               bool k3, const SolveProgress& progress);

void print_intrinsics(const std::vector<IntrinsicsResult>& results, const Output& output);

// Extrinsics from a walking person, `extrinsics --person`; in person_verb.cc.

struct PersonArguments {
    std::string session, intrinsics;
    double stature_m = 0;  // of the subject; 0: unknown
    int frame_sets = 150;
    Output output;
};

absl::Status person_extrinsics(const PersonArguments& arguments);

}  // namespace kinevox::calibrate
