// Files that only their owner may read.
#pragma once

#include <absl/status/status.h>

#include <filesystem>
#include <string_view>

namespace kinevox {

// If it does not exist.
void make_private_folder(const std::filesystem::path& folder);

enum class Existing { kKeep, kReplace };

// Atomically (temporary file, rename), with mode 0600. kKeep: AlreadyExists if the file exists.
absl::Status write_private_file(const std::filesystem::path& file, std::string_view contents,
                                Existing existing);

// PermissionDenied if others than the owner may read or write the file.
absl::Status check_private(const std::filesystem::path& file);

}  // namespace kinevox
