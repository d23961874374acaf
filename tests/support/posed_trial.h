// A trial as `kinevox process` writes it, from the body model: a person who turns, walks on the
// spot, raises the arms and bends, so that every coordinate moves.
#pragma once

#include <absl/status/status.h>

#include <filesystem>

#include "server/pose/body_model.h"
#include "server/recording/subject_names.h"

namespace kinevox::testing {

inline constexpr int kPosedTrialFrames = 40;
inline constexpr double kPosedTrialFps = 50;

BodyCoordinates posed_coordinates(int frame);

// joints.csv, angles.csv, coordinates.csv and body.toml. With `gaps`: nothing in frames 10 to 12, no right
// hand in frame 20, which takes the wrist's coordinate with it.
absl::Status write_posed_trial(const std::filesystem::path& folder, bool gaps);

// The same of `count` people with the ids from 1 on, 1.5 m apart along y, each with a body of its own;
// `names` are written as the recorder does.
absl::Status write_posed_people(const std::filesystem::path& folder, int count, const SubjectNames& names);

}  // namespace kinevox::testing
