#include "server/recording/anonymous_export.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <stdlib.h>

#include <system_error>
#include <utility>

#include "common/atomic_file.h"
#include "common/session_file.h"
#include "server/recording/anonymous_session.h"
#include "server/recording/overlay_video.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

constexpr double kSilhouettesFraction = 0.8;  // of the time; the rest is for the video

// A hidden folder next to the video, on the disk that has space for it.
class TemporaryFolder {
  public:
    explicit TemporaryFolder(const fs::path& file) {
        std::error_code error;
        std::string pattern =
            (fs::absolute(file, error).parent_path() / ".kinevox-silhouettes-XXXXXX").string();
        if (::mkdtemp(pattern.data())) path_ = pattern;
    }
    ~TemporaryFolder() {
        std::error_code ignored;
        if (!path_.empty()) fs::remove_all(path_, ignored);
    }
    TemporaryFolder(const TemporaryFolder&) = delete;
    TemporaryFolder& operator=(const TemporaryFolder&) = delete;
    const fs::path& path() const { return path_; }

  private:
    fs::path path_;
};

absl::StatusOr<std::string> anonymous_name(const Session& session, const std::string& camera) {
    std::vector<std::string> names;
    for (std::size_t c = 0; c < session.cameras.size(); ++c) {
        if (session.cameras[c].name == camera) return anonymous_camera_name(c);
        names.push_back(session.cameras[c].name);
    }
    if (camera.empty()) return "";
    return absl::NotFoundError(fmt::format("session \"{}\" has no camera \"{}\"; it has {}", session.name,
                                           camera, fmt::join(names, ", ")));
}

}  // namespace

absl::StatusOr<ExportedFiles> export_anonymous(const Session& session, const Trial& trial, const Trial& slice,
                                               const ExportOptions& options, const fs::path& out,
                                               const JobControl& work) {
    const auto camera = anonymous_name(session, options.camera);
    if (!camera.ok()) return camera.status();
    ExportedFiles written;
    written.frames = static_cast<std::int64_t>(slice.size());
    written.rate_hz = slice.rate_hz;
    const OverlayOptions overlay{.camera = *camera, .width_px = options.width_px, .silhouettes = true};
    const JobControl silhouettes = work.subrange(0, kSilhouettesFraction),
                     drawing = work.subrange(kSilhouettesFraction, 1);
    if (options.format == ExportFormat::kMp4) {
        const TemporaryFolder temporary(out);
        if (temporary.path().empty())
            return absl::UnavailableError(
                fmt::format("{}: its folder is not writable; correct the path", out.string()));
        const auto made =
            write_anonymous_session(session, trial, temporary.path(), options.low_priority, silhouettes);
        if (!made.ok()) return made.status();
        written.files.push_back(out);
        if (absl::Status done = write_overlay_video(made->session, slice, overlay, out, drawing); !done.ok())
            return done;
        return written;
    }
    auto made = write_anonymous_session(session, trial, out, options.low_priority, silhouettes);
    if (!made.ok()) return made.status();
    const fs::path video = out / "video.mp4", readme = out / "README.txt";
    if (absl::Status done = write_overlay_video(made->session, slice, overlay, video, drawing); !done.ok())
        return done;
    if (absl::Status done = write_file_atomically(readme, anonymous_readme()); !done.ok()) return done;
    written.files = std::move(made->files);
    written.files.push_back(video);
    written.files.push_back(readme);
    return written;
}

}  // namespace kinevox
