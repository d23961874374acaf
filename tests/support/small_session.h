// A session small enough to be rendered within a test: one person, four cameras, folders of PNGs.
#pragma once

#include <filesystem>

namespace kinevox::testing {

struct SmallSession {
    int frames = 12;
    int width = 160, height = 120;  // px
    double fps = 20;
};

// Writes session.toml, calibration.toml and the images into `folder`; the session file's path.
std::filesystem::path write_small_session(const std::filesystem::path& folder, const SmallSession& what = {});

// A fresh folder below the test's temporary one, removed with the object.
class TemporaryFolder {
  public:
    TemporaryFolder();
    ~TemporaryFolder();
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    const std::filesystem::path& path() const { return path_; }

  private:
    std::filesystem::path path_;
};

}  // namespace kinevox::testing
