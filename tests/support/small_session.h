// A session small enough to be rendered within a test: one person, four cameras, folders of PNGs.
#pragma once

#include <filesystem>

#include "tests/support/temporary_folder.h"

namespace kinevox::testing {

struct SmallSession {
    int frames = 12;
    int width = 160, height = 120;  // px
    double fps = 20;
};

// Writes session.toml, calibration.toml and the images into `folder`; the session file's path.
std::filesystem::path write_small_session(const std::filesystem::path& folder, const SmallSession& what = {});

}  // namespace kinevox::testing
