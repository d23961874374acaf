#include "server/recording/append_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

namespace kinevox {

absl::StatusOr<AppendFile> AppendFile::create(const std::filesystem::path& file) {
    AppendFile made;
    made.path_ = file;
    made.descriptor_ = ::open(file.c_str(), O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0644);
    if (made.descriptor_ < 0) return made.failed(errno);
    return made;
}

AppendFile::AppendFile(AppendFile&& other) noexcept {
    *this = std::move(other);
}

AppendFile& AppendFile::operator=(AppendFile&& other) noexcept {
    std::swap(path_, other.path_);
    std::swap(descriptor_, other.descriptor_);
    std::swap(size_, other.size_);
    return *this;
}

AppendFile::~AppendFile() {
    if (descriptor_ >= 0) ::close(descriptor_);
}

absl::Status AppendFile::failed(int error) const {
    const std::string what = fmt::format("{}: {}", path_.string(), std::strerror(error));
    if (error == ENOSPC || error == EDQUOT)
        return absl::ResourceExhaustedError(what + "; free some space or record to another disk");
    if (error == EEXIST) return absl::AlreadyExistsError(what + "; choose another name");
    return absl::UnavailableError(what + "; correct [recording] folder or its rights");
}

absl::Status AppendFile::write_at(std::uint64_t offset, std::string_view bytes) {
    while (!bytes.empty()) {
        const ssize_t written = ::pwrite(descriptor_, bytes.data(), bytes.size(), static_cast<off_t>(offset));
        if (written < 0 && errno == EINTR) continue;
        if (written <= 0) return failed(written < 0 ? errno : EIO);
        bytes.remove_prefix(static_cast<std::size_t>(written));
        offset += static_cast<std::uint64_t>(written);
        size_ = std::max(size_, offset);
    }
    return absl::OkStatus();
}

absl::Status AppendFile::append(std::string_view bytes) {
    const std::uint64_t before = size_;
    absl::Status written = write_at(before, bytes);
    if (!written.ok()) truncate(before).IgnoreError();
    return written;
}

absl::Status AppendFile::truncate(std::uint64_t bytes) {
    if (::ftruncate(descriptor_, static_cast<off_t>(bytes)) != 0) return failed(errno);
    size_ = bytes;
    return absl::OkStatus();
}

void AppendFile::sync() const {
    ::fdatasync(descriptor_);
}

bool AppendFile::lock() const {
    return ::flock(descriptor_, LOCK_EX | LOCK_NB) == 0;
}

}  // namespace kinevox
