// Where deleted recordings and calibrations wait before they are gone: moved back, they are restored.
#pragma once

namespace kinevox {

inline constexpr const char* kBinFolder = "deleted";  // inside the folder that stores them
inline constexpr double kBinDays = 7;

}  // namespace kinevox
