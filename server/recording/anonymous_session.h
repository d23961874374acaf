// A session that can be passed on: silhouettes in the pictures' place, and no names, dates and machines.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <string>
#include <vector>

#include "common/session_file.h"
#include "server/recording/long_work.h"
#include "server/recording/trial.h"

namespace kinevox {

inline constexpr const char* kAnonymous = "anonymous";  // in the place of every name

// "cam_01" for the first one: cameras are often named after rooms and machines.
std::string anonymous_camera_name(std::size_t camera);

struct AnonymousSession {
    Session session;
    std::vector<std::filesystem::path> files;
};

// Into `folder`, which is there, a recording as docs/recording.md describes it, all in one folder: videos of
// the main subject's silhouettes, white on black, black backgrounds, calibration, volumes without colours and
// the trial's tables; times count from the first frame set. Of the session as many frame sets as the trial
// has. `one_thread` as SilhouettePassOptions; errors as find_silhouettes().
absl::StatusOr<AnonymousSession> write_anonymous_session(const Session& session, const Trial& trial,
                                                         const std::filesystem::path& folder, bool one_thread,
                                                         const LongWork& work);

// README.txt for it and the film beside it: what is there, what was left out, and who can still be recognised
// by what.
std::string anonymous_readme();

}  // namespace kinevox
