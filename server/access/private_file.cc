#include "server/access/private_file.h"

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <string>
#include <system_error>

#include "common/files.h"

namespace kinevox {
namespace {

absl::Status cannot_write(const std::filesystem::path& file, int error) {
    return absl::UnavailableError(
        fmt::format("{}: cannot be written: {}; check the folder's permissions and free space", file.string(),
                    std::strerror(error)));
}

}  // namespace

void make_private_folder(const std::filesystem::path& folder) {
    std::error_code ignored;  // writing the file reports it
    if (folder.empty() || std::filesystem::exists(folder, ignored)) return;
    std::filesystem::create_directories(folder, ignored);
    std::filesystem::permissions(folder, std::filesystem::perms::owner_all, ignored);
}

absl::Status write_private_file(const std::filesystem::path& file, std::string_view contents,
                                Existing existing) {
    make_private_folder(file.parent_path());
    std::string temporary = file.string() + ".XXXXXX";
    const int descriptor = ::mkostemp(temporary.data(), O_CLOEXEC);  // with mode 0600
    if (descriptor < 0) return cannot_write(file, errno);
    bool done = write_all(descriptor, contents);
    int error = errno;
    ::close(descriptor);
    if (done) {
        // A link, unlike a rename, does not replace an existing file.
        done = existing == Existing::kReplace ? ::rename(temporary.c_str(), file.c_str()) == 0
                                              : ::link(temporary.c_str(), file.c_str()) == 0;
        error = errno;
    }
    if (!done || existing == Existing::kKeep) ::unlink(temporary.c_str());
    if (done) return absl::OkStatus();
    if (error == EEXIST)
        return absl::AlreadyExistsError(fmt::format(
            "{} is there already and is not replaced; move it away, or name another place", file.string()));
    return cannot_write(file, error);
}

absl::Status check_private(const std::filesystem::path& file) {
    struct stat found {};
    if (::stat(file.c_str(), &found) != 0)
        return absl::NotFoundError(
            fmt::format("{}: {}; check the path", file.string(), std::strerror(errno)));
    if ((found.st_mode & 077) == 0) return absl::OkStatus();
    return absl::PermissionDeniedError(
        fmt::format("{}: its mode is {:o}, so that others than its owner have rights to it; "
                    "chmod 600 it",
                    file.string(), found.st_mode & 0777));
}

}  // namespace kinevox
