// Sessions whose videos were started one by one: which pictures belong together, and the offsets in
// session.toml.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "common/session_file.h"

namespace kinevox {

// True where any camera has an offset_s: its videos may then begin and end at different times.
bool has_offsets(const Session& session);

// Per camera the number of the picture, from 0, that belongs to the first frame set: the first at which all
// cameras have begun. Frame set s holds picture first + s of each camera. Where the cameras' pictures lie
// between each other, those are joined that lie within the shortest time, which is less than a frame. All 0
// without offsets.
std::vector<std::int64_t> first_pictures(const Session& session);

// How many frame sets there are where camera c has pictures[c] of them, counted from first_pictures().
// InvalidArgument names the cameras where one begins when another has ended.
absl::StatusOr<std::int64_t> common_length(const Session& session, std::span<const std::int64_t> pictures);

// The text of a session.toml with one offset_s in each [[camera]], in the order of the file: all else stays,
// comments too. InvalidArgument where the cameras are written in a form that is not understood here (a table
// within a line).
absl::StatusOr<std::string> with_offsets(const std::string& text, std::span<const double> offsets_s);

// Replaces the file by with_offsets(), or, where that cannot be, by write_session(), which costs its
// comments. Written aside and renamed.
absl::Status write_offsets(const std::filesystem::path& session_file, std::span<const double> offsets_s);

}  // namespace kinevox
