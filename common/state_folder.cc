#include "common/state_folder.h"

#include <cstdlib>

namespace kinevox {

std::filesystem::path in_state_folder(std::string_view name) {
    std::filesystem::path folder;
    if (const char* state = std::getenv("XDG_STATE_HOME"); state && *state == '/')
        folder = state;
    else if (const char* home = std::getenv("HOME"); home && *home == '/')
        folder = std::filesystem::path(home) / ".local/state";
    return folder.empty() ? folder : folder / "kinevox" / name;
}

}  // namespace kinevox
