// A temporary folder for parsers that read files only.
#pragma once

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <system_error>

#include "tests/fuzz/fuzz_check.h"

namespace kinevox::testing {

class FuzzedFolder {
  public:
    FuzzedFolder() {
        std::error_code none;
        std::string pattern = std::filesystem::is_directory("/dev/shm", none) ? "/dev/shm/kinevox-fuzz-XXXXXX"
                                                                              : "/tmp/kinevox-fuzz-XXXXXX";
        FUZZ_CHECK(::mkdtemp(pattern.data()) != nullptr);
        path_ = pattern;
    }
    ~FuzzedFolder() {
        std::error_code ignored;
        std::filesystem::remove_all(path_, ignored);
    }
    FuzzedFolder(const FuzzedFolder&) = delete;
    FuzzedFolder& operator=(const FuzzedFolder&) = delete;

    const std::filesystem::path& path() const { return path_; }

    std::filesystem::path write(const std::string& name, std::string_view bytes) const {
        std::ofstream(path_ / name, std::ios::binary | std::ios::trunc) << bytes;
        return path_ / name;
    }

  private:
    std::filesystem::path path_;
};

}  // namespace kinevox::testing
