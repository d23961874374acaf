#include "common/files.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <unistd.h>

#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <system_error>

namespace kinevox {
namespace {

absl::Status cannot_write(const std::filesystem::path& file, const std::string& why) {
    return absl::UnavailableError(fmt::format(
        "{}: cannot be written: {}; check the folder's permissions and free space", file.string(), why));
}

}  // namespace

bool write_all(int descriptor, std::string_view contents) {
    while (!contents.empty()) {
        const ssize_t written = ::write(descriptor, contents.data(), contents.size());
        if (written < 0 && errno == EINTR) continue;
        if (written < 0) return false;
        contents.remove_prefix(static_cast<std::size_t>(written));
    }
    return ::fsync(descriptor) == 0 || errno == EINVAL;  // EINVAL: a pipe or the like, nothing to flush
}

absl::Status write_file_atomically(const std::filesystem::path& file, std::string_view contents) {
    static std::atomic<unsigned> counter{0};  // two threads that write one file need two temporary names
    std::error_code error;
    if (file.has_parent_path()) std::filesystem::create_directories(file.parent_path(), error);
    if (error) return cannot_write(file, error.message());
    std::filesystem::path temporary = file;
    temporary += fmt::format(".{}-{}.part", ::getpid(), counter.fetch_add(1));
    const int descriptor = ::open(temporary.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
    if (descriptor < 0) return cannot_write(file, std::strerror(errno));
    const bool written = write_all(descriptor, contents);
    const int write_errno = errno;
    const bool closed = ::close(descriptor) == 0;
    if (!written || !closed) {
        ::unlink(temporary.c_str());
        return cannot_write(file, std::strerror(written ? errno : write_errno));
    }
    std::filesystem::rename(temporary, file, error);
    if (error) {
        ::unlink(temporary.c_str());
        return cannot_write(file, error.message());
    }
    return absl::OkStatus();
}

absl::StatusOr<std::string> read_file(const std::filesystem::path& file, std::size_t max_bytes) {
    std::error_code error;
    if (!std::filesystem::exists(file, error))
        return absl::NotFoundError(fmt::format("{}: no such file; check the path", file.string()));
    if (!std::filesystem::is_regular_file(file, error))
        return absl::InvalidArgumentError(
            fmt::format("{}: is not a file; give the file itself", file.string()));
    std::ifstream stream(file, std::ios::binary);
    if (!stream)
        return absl::PermissionDeniedError(fmt::format("{}: cannot be opened: {}; check its permissions",
                                                       file.string(), std::strerror(errno)));
    std::string contents;
    char block[65536];
    while (stream.read(block, sizeof block) || stream.gcount() > 0) {
        contents.append(block, static_cast<std::size_t>(stream.gcount()));
        if (contents.size() > max_bytes)
            return absl::InvalidArgumentError(
                fmt::format("{}: is larger than {} bytes, too large for a file of this kind; check the path",
                            file.string(), max_bytes));
    }
    if (stream.bad())
        return absl::DataLossError(
            fmt::format("{}: cannot be read to its end; check the disk", file.string()));
    return contents;
}

absl::StatusOr<std::filesystem::path> folder_of(const std::filesystem::path& file) {
    std::error_code error;
    const std::filesystem::path absolute = std::filesystem::absolute(file, error);
    if (error)
        return absl::InvalidArgumentError(
            fmt::format("{}: {}; check the path", file.string(), error.message()));
    return absolute.lexically_normal().parent_path();
}

std::filesystem::path in_state_folder(std::string_view name) {
    std::filesystem::path folder;
    if (const char* state = std::getenv("XDG_STATE_HOME"); state && *state == '/')
        folder = state;
    else if (const char* home = std::getenv("HOME"); home && *home == '/')
        folder = std::filesystem::path(home) / ".local/state";
    return folder.empty() ? folder : folder / "kinevox" / name;
}

}  // namespace kinevox
