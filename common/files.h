// Files: written atomically (temporary file, rename), so that readers never see a partial one, and read
// whole; where state is stored, and numbers in binary files.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <concepts>
#include <cstddef>
#include <filesystem>
#include <string>
#include <string_view>
#include <type_traits>

namespace kinevox {

// Replaces `file` by `contents`, creating its folder if needed. On an error the old file is unchanged.
absl::Status write_file_atomically(const std::filesystem::path& file, std::string_view contents);

// Writes everything to an open file and flushes it to the disk; errno has the error.
bool write_all(int descriptor, std::string_view contents);

// The whole file. NotFound if it is not there, InvalidArgument if it is larger than `max_bytes` or no file.
absl::StatusOr<std::string> read_file(const std::filesystem::path& file, std::size_t max_bytes = 16 << 20);

// The absolute folder to which a file's relative paths refer.
absl::StatusOr<std::filesystem::path> folder_of(const std::filesystem::path& file);

// kinevox/NAME in $XDG_STATE_HOME, else in ~/.local/state; empty for a user without a home. Not a cache: the
// files hold what users added (XDG base directory specification).
std::filesystem::path in_state_folder(std::string_view name);

// Whole numbers as bytes, the lowest first, whatever the machine's own order.
template <std::integral T>
void put_little_endian(std::string& to, T value) {
    for (std::size_t i = 0; i < sizeof(T); ++i)
        to += static_cast<char>(static_cast<std::make_unsigned_t<T>>(value) >> (8 * i) & 0xff);
}

// The number that `from`, at least as long, begins with; it is taken off.
template <std::unsigned_integral T>
T take_little_endian(std::string_view& from) {
    T value = 0;
    for (std::size_t i = 0; i < sizeof(T); ++i)
        value |= static_cast<T>(static_cast<T>(static_cast<unsigned char>(from[i])) << (8 * i));
    from.remove_prefix(sizeof(T));
    return value;
}

}  // namespace kinevox
