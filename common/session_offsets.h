// Sessions whose videos were started one by one: their frame sets, and the offsets in session.toml.
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

// True if any camera has an offset_s: its videos may then start and end at different times.
bool has_offsets(const Session& session);

// Per camera the index of the image in the first frame set: the first at which all cameras have started.
// Frame set s holds image first + s of each camera. If the cameras' images alternate, those within the
// shortest time, which is less than a frame, are joined. All 0 without offsets.
std::vector<std::int64_t> first_image_indices(const Session& session);

// Number of frame sets if camera c has images[c] images, counted from first_image_indices(). InvalidArgument
// names the cameras if one starts after another has ended.
absl::StatusOr<std::int64_t> common_length(const Session& session, std::span<const std::int64_t> images);

// The text of a session.toml with one offset_s in each [[camera]], in the order of the file; everything else
// stays, including comments. InvalidArgument for inline tables, which are not supported here.
absl::StatusOr<std::string> with_offsets(const std::string& text, std::span<const double> offsets_s);

// Replaces the file by with_offsets() or, if that fails, by write_session(), which loses its comments.
// Atomic.
absl::Status write_offsets(const std::filesystem::path& session_file, std::span<const double> offsets_s);

}  // namespace kinevox
