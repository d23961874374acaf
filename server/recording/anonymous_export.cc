#include "server/recording/anonymous_export.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <stdlib.h>

#include <system_error>
#include <utility>

#include "common/atomic_file.h"
#include "common/session_file.h"
#include "server/recording/anonymous_session.h"
#include "server/recording/overlay_film.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

constexpr double kSilhouettesShare = 0.8;  // of the time, the rest is the film's

// A hidden folder beside the film, where there is room for it.
class FolderBeside {
  public:
    explicit FolderBeside(const fs::path& file) {
        std::error_code error;
        std::string pattern =
            (fs::absolute(file, error).parent_path() / ".kinevox-silhouettes-XXXXXX").string();
        if (::mkdtemp(pattern.data())) path_ = pattern;
    }
    ~FolderBeside() {
        std::error_code ignored;
        if (!path_.empty()) fs::remove_all(path_, ignored);
    }
    FolderBeside(const FolderBeside&) = delete;
    FolderBeside& operator=(const FolderBeside&) = delete;
    const fs::path& path() const { return path_; }

  private:
    fs::path path_;
};

absl::StatusOr<std::string> new_name(const Session& session, const std::string& camera) {
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

absl::StatusOr<ExportedFiles> export_anonymous(const Session& session, const Trial& trial, const Trial& part,
                                               const ExportOptions& options, const fs::path& out,
                                               const LongWork& work) {
    const auto camera = new_name(session, options.camera);
    if (!camera.ok()) return camera.status();
    ExportedFiles written;
    written.frames = static_cast<std::int64_t>(part.size());
    written.rate_hz = part.rate_hz;
    const OverlayOptions overlay{.camera = *camera, .width_px = options.width_px, .silhouettes = true};
    const LongWork silhouettes = work.part(0, kSilhouettesShare), drawing = work.part(kSilhouettesShare, 1);
    if (options.format == "mp4") {
        const FolderBeside beside(out);
        if (beside.path().empty())
            return absl::UnavailableError(
                fmt::format("{}: nothing can be written beside it; correct the path", out.string()));
        const auto made =
            write_anonymous_session(session, trial, beside.path(), options.beside_capture, silhouettes);
        if (!made.ok()) return made.status();
        written.files.push_back(out);
        if (absl::Status done = write_overlay_film(made->session, part, overlay, out, drawing); !done.ok())
            return done;
        return written;
    }
    auto made = write_anonymous_session(session, trial, out, options.beside_capture, silhouettes);
    if (!made.ok()) return made.status();
    const fs::path film = out / "film.mp4", readme = out / "README.txt";
    if (absl::Status done = write_overlay_film(made->session, part, overlay, film, drawing); !done.ok())
        return done;
    if (absl::Status done = write_file_atomically(readme, anonymous_readme()); !done.ok()) return done;
    written.files = std::move(made->files);
    written.files.push_back(film);
    written.files.push_back(readme);
    return written;
}

}  // namespace kinevox
