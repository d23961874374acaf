// Where programs keep what they were taught.
#pragma once

#include <filesystem>
#include <string_view>

namespace kinevox {

// kinevox/NAME in $XDG_STATE_HOME, else in ~/.local/state; empty for a user without a home. Not a cache: the
// files hold what users added (XDG base directory specification).
std::filesystem::path in_state_folder(std::string_view name);

}  // namespace kinevox
