// Clicked points as text.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <string_view>
#include <vector>

#include "server/calibration/floor.h"

namespace kinevox {

// "0,0,0 cam1:412.5,300 cam3:99,120": world coordinates in m where they are known, then camera:u,v in px of
// each click. InvalidArgument names what is wrong in one line.
absl::StatusOr<FloorPoint> parse_floor_point(std::string_view text, const std::vector<Camera>& cameras);

// A point a line; empty lines and what follows a # do not count.
absl::StatusOr<std::vector<FloorPoint>> read_floor_points(const std::filesystem::path& file,
                                                          const std::vector<Camera>& cameras);

}  // namespace kinevox
