#pragma once

namespace kinevox {

inline constexpr const char* kVersion = KINEVOX_VERSION;  // the project's, from CMake

}  // namespace kinevox
