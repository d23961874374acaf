// Scene files: everything that the virtual studio shows, in TOML, so that a trial can be rendered again.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <string_view>

#include "server/cameras/studio/session_writer.h"
#include "server/cameras/studio/studio.h"

namespace kinevox::studio {

struct Scene {
    StudioOptions studio;
    SessionWriterOptions writer;
};

// Keys that are missing have the defaults of StudioOptions and SessionWriterOptions or are drawn from the
// seed. NotFound or InvalidArgument, one line with file and line number; docs/studio.md lists the keys.
absl::StatusOr<Scene> read_scene(const std::filesystem::path& file);
absl::StatusOr<Scene> parse_scene(std::string_view text, std::string_view name_for_errors);

}  // namespace kinevox::studio
