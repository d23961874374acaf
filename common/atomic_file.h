// Files written atomically (temporary file, rename): readers never see a partial file.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <string>
#include <string_view>

namespace kinevox {

// Replaces `file` by `contents`, creating its folder if needed. On an error the old file is unchanged.
absl::Status write_file_atomically(const std::filesystem::path& file, std::string_view contents);

// Writes everything to an open file and flushes it to the disk; errno has the error.
bool write_all(int descriptor, std::string_view contents);

// The whole file. NotFound if it is not there, InvalidArgument if it is larger than `max_bytes` or no file.
absl::StatusOr<std::string> read_file(const std::filesystem::path& file, std::size_t max_bytes = 16 << 20);

// The absolute folder to which a file's relative paths refer.
absl::StatusOr<std::filesystem::path> folder_of(const std::filesystem::path& file);

}  // namespace kinevox
