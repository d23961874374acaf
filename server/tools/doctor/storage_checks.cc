#include <fcntl.h>
#include <fmt/format.h>
#include <pwd.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <system_error>

#include "common/calibration_file.h"
#include "common/stopwatch.h"
#include "server/tools/doctor/checks.h"

namespace kinevox::doctor {
namespace {

namespace fs = std::filesystem;

// The folder, or its nearest existing ancestor.
fs::path nearest(fs::path folder) {
    std::error_code error;
    while (!folder.empty() && folder != folder.parent_path() && !fs::exists(folder, error))
        folder = folder.parent_path();
    return folder;
}

// Bytes per second of the cameras' images; a lossless codec halves them.
double image_rate(const DaemonConfig& config) {
    switch (config.source.kind) {
        case SourceConfig::Kind::kStudio: {
            const StudioConfig& studio = config.source.studio;
            return 3.0 * studio.width_px * studio.height_px * studio.camera_count * studio.fps;
        }
        case SourceConfig::Kind::kCameras: {
            const auto cameras = read_calibration(config.source.cameras.calibration_file);
            double pixels = 0;
            if (cameras.ok())
                for (const LiveCameraConfig& wanted : config.source.cameras.cameras)
                    for (const Camera& camera : *cameras)
                        if (camera.name == wanted.name) pixels += 1.0 * camera.width * camera.height;
            return 3.0 * pixels * config.source.cameras.fps;
        }
        case SourceConfig::Kind::kSession:
            break;
    }
    return 0;
}

// Bytes per second to the disk, without the page cache; negative if writing fails.
double write_speed(const fs::path& folder, std::uint64_t bytes) {
    std::string name = (folder / ".kinevox-doctor-XXXXXX").string();
    const int file = mkostemp(name.data(), O_CLOEXEC);
    if (file < 0) return -1;
    unlink(name.c_str());  // deleted in any case
    std::string block(std::size_t{4} << 20, '\0');
    unsigned random = 1;
    for (char& byte : block)
        byte = static_cast<char>((random = random * 1664525u + 1013904223u) >> 24);  // not compressible
    const Stopwatch writing;
    std::uint64_t written = 0;
    bool ok = true;
    while (ok && written < bytes) {
        const ssize_t count =
            write(file, block.data(), std::min<std::uint64_t>(block.size(), bytes - written));
        ok = count > 0;
        written += static_cast<std::uint64_t>(std::max<ssize_t>(count, 0));
    }
    ok = ok && fdatasync(file) == 0;
    const double seconds = writing.seconds();
    close(file);
    return ok ? static_cast<double>(written) / std::max(seconds, 1e-6) : -1;
}

std::string owner_of(const struct stat& of) {
    const passwd* user = getpwuid(of.st_uid);
    return user ? user->pw_name : std::to_string(of.st_uid);
}

Finding space(const Facts& facts, const fs::path& folder, double rate) {
    struct statvfs disk {};
    if (statvfs(folder.c_str(), &disk) != 0)
        return {Severity::kError, "disk space",
                fmt::format("{}: {}", folder.string(), std::generic_category().message(errno)),
                "correct [recording] folder"};
    const double free = static_cast<double>(disk.f_bavail) * static_cast<double>(disk.f_frsize);
    const double least = static_cast<double>(facts.settings().recording.min_free_disk_mb) * (1 << 20);
    const double seconds = rate > 0 ? std::max(free - least, 0.0) / (rate / 2) : 1e9;
    const std::string what =
        fmt::format("{:.0f} GB are free for {}{}", free / 1e9, facts.recordings.string(),
                    rate > 0 ? fmt::format(": about {:.0f} minutes of recordings", seconds / 60) : "");
    if (free <= least)
        return {Severity::kError, "disk space",
                what + ", less than [recording] min_free_disk_mb: nothing can be recorded",
                "`kinevox record delete` what is not needed, or set [recording] folder to another disk"};
    if (seconds < 600)
        return {Severity::kWarning, "disk space", what,
                "`kinevox record delete` what is not needed, or set [recording] folder to another disk"};
    return {Severity::kOk, "disk space", what};
}

}  // namespace

Findings check_state(const Facts& facts) {
    if (facts.state_folder.empty())
        return {{Severity::kWarning, "state",
                 "no folder for calibrations, backgrounds, bodies and poses: they are lost at the end",
                 "set XDG_STATE_HOME, or install the service"}};
    struct stat of {};
    const std::string folder = facts.state_folder.string();
    if (stat(facts.state_folder.c_str(), &of) != 0) {
        const fs::path above = nearest(facts.state_folder);
        if (access(above.c_str(), W_OK) == 0)
            return {{Severity::kOk, "state", folder + " is created on demand"}};
        return {{Severity::kError, "state",
                 fmt::format("{} does not exist and cannot be created below {}", folder, above.string()),
                 "create it for the daemon's user"}};
    }
    // The service's folder belongs to the service; other users have their own.
    const passwd* user = getpwnam("kinevox");
    const bool of_service = folder.starts_with(facts.machine.at("var/lib/kinevox").string());
    if (of_service && user && of.st_uid != user->pw_uid)
        return {{Severity::kError,
                 "state",
                 fmt::format("{} belongs to {}, the service runs as kinevox", folder, owner_of(of)),
                 "chown -R kinevox:kinevox " + folder,
                 {{Fix::Kind::kCommand, "chown -R kinevox:kinevox '" + folder + "'"}}}};
    if (of.st_mode & S_IWOTH)
        return {{Severity::kError,
                 "state",
                 folder + " may be written by everybody",
                 "chmod o-w " + folder,
                 {{Fix::Kind::kCommand, "chmod o-w '" + folder + "'"}}}};
    if (!of_service && access(folder.c_str(), W_OK) != 0)
        return {{Severity::kError, "state",
                 fmt::format("{} belongs to {} and may not be written by you", folder, owner_of(of)),
                 "give it to the daemon's user, or set XDG_STATE_HOME"}};
    return {{Severity::kOk, "state", fmt::format("{} belongs to {}", folder, owner_of(of))}};
}

Findings check_disk(const Facts& facts) {
    if (facts.recordings.empty()) return {{Severity::kOk, "disk space", "the configuration records nothing"}};
    const fs::path folder = nearest(facts.recordings);
    const double rate = image_rate(facts.settings());
    Findings out{space(facts, folder, rate)};
    if (access(folder.c_str(), W_OK) != 0) {
        out.push_back(
            {Severity::kWarning, "disk speed",
             fmt::format("{} may not be written by you, so its speed is not known", folder.string()),
             "run this as root"});
        return out;
    }
    if (out.front().severity == Severity::kError) return out;  // no room for the test either
    const double speed = write_speed(folder, facts.disk_test_bytes);
    const std::string what =
        fmt::format("{} writes {:.0f} MB/s; the cameras deliver {:.0f} MB/s, about half of it when encoded",
                    folder.string(), speed / 1e6, rate / 1e6);
    if (speed < 0)
        out.push_back({Severity::kError, "disk speed",
                       fmt::format("{}: {}", folder.string(), std::generic_category().message(errno)),
                       "check whether the disk is full or mounted read-only"});
    else if (speed < rate / 2)
        out.push_back({Severity::kError, "disk speed", what,
                       "record to a faster disk, or with [recording] codec = \"h264\""});
    else if (speed < rate)
        out.push_back(
            {Severity::kWarning, "disk speed", what, "a busy disk may be too slow: record to a faster one"});
    else
        out.push_back({Severity::kOk, "disk speed", what});
    return out;
}

}  // namespace kinevox::doctor
