// Parses clicked points.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <string_view>
#include <vector>

#include "server/calibration/board/floor.h"

namespace kinevox {

// "0,0,0 cam1:412.5,300 cam3:99,120": optional world coordinates in m, then camera:u,v in px per click.
// InvalidArgument, one line.
absl::StatusOr<FloorPoint> parse_floor_point(std::string_view text, const std::vector<Camera>& cameras);

// One point per line; empty lines and comments after # are ignored.
absl::StatusOr<std::vector<FloorPoint>> read_floor_points(const std::filesystem::path& file,
                                                          const std::vector<Camera>& cameras);

}  // namespace kinevox
