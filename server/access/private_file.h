// Files that only their owner may read.
#pragma once

#include <absl/status/status.h>

#include <filesystem>
#include <string_view>

namespace kinevox {

// Where it is not there.
void make_private_folder(const std::filesystem::path& folder);

enum class Existing { kKeep, kReplace };

// Writes aside with mode 0600 and renames. kKeep: AlreadyExists where the file is there.
absl::Status write_private_file(const std::filesystem::path& file, std::string_view contents,
                                Existing existing);

// PermissionDenied where others than its owner may read or write the file.
absl::Status check_private(const std::filesystem::path& file);

}  // namespace kinevox
