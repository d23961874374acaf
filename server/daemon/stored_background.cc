#include "server/daemon/stored_background.h"

#include <fmt/chrono.h>
#include <fmt/format.h>

#include <chrono>
#include <system_error>

#include "common/session_file.h"
#include "server/cameras/session_files.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

fs::path beside(const fs::path& folder, const char* suffix) {
    return fs::path(folder.string() + suffix);
}

std::string when(const fs::path& file) {
    std::error_code error;
    const auto time = fs::last_write_time(file, error);
    if (error) return "an unknown day";
    const auto system =
        std::chrono::time_point_cast<std::chrono::seconds>(std::chrono::file_clock::to_sys(time));
    return fmt::format("{:%Y-%m-%d %H:%M} UTC", fmt::gmtime(std::chrono::system_clock::to_time_t(system)));
}

class RestoringSource final : public FrameSource {
  public:
    RestoringSource(std::unique_ptr<FrameSource> source, StoredBackground& stored)
        : source_(std::move(source)), stored_(stored) {}

    const std::vector<Camera>& cameras() const override { return source_->cameras(); }
    double fps() const override { return source_->fps(); }
    std::int64_t frame_count() const override { return source_->frame_count(); }
    absl::StatusOr<std::vector<std::vector<Picture>>> background() override {
        auto own = source_->background();
        if (!own.ok() || !own->empty()) return own;
        return stored_.read(source_->cameras());
    }
    absl::StatusOr<FrameSet> next() override { return source_->next(); }
    void stop() override { source_->stop(); }
    std::vector<CameraLink> camera_links() const override { return source_->camera_links(); }
    void set_on_camera_event(OnCameraEvent on_event) override {
        source_->set_on_camera_event(std::move(on_event));
    }

  private:
    const std::unique_ptr<FrameSource> source_;
    StoredBackground& stored_;
};

}  // namespace

StoredBackground::StoredBackground(fs::path folder, Tell tell)
    : folder_(std::move(folder)), tell_(std::move(tell)) {}

StoredBackground::~StoredBackground() = default;

std::unique_ptr<FrameSource> StoredBackground::restoring(std::unique_ptr<FrameSource> source) {
    if (folder_.empty()) return source;
    return std::make_unique<RestoringSource>(std::move(source), *this);
}

std::vector<std::vector<Picture>> StoredBackground::read(const std::vector<Camera>& cameras) {
    Session session;
    session.recording.emplace();  // all pictures count
    std::error_code error;
    if (folder_.empty() || !fs::is_directory(folder_, error)) return {};
    for (const Camera& camera : cameras) {
        const fs::path video = folder_ / (camera.name + ".mkv");
        if (!fs::exists(video, error)) {
            tell_(fmt::format("the background in {} is not of these cameras, it lacks {}; learn it anew",
                              folder_.string(), camera.name));
            return {};
        }
        session.cameras.push_back({camera.name, {}, video});
    }
    auto pictures = read_backgrounds(session, cameras);
    if (!pictures.ok()) {
        tell_(fmt::format("the stored background is not used: {}; learn it anew",
                          std::string(pictures.status().message())));
        return {};
    }
    if (pictures->empty() || pictures->front().empty()) return {};
    restored_ = pictures->front().front().data.get();
    tell_(fmt::format(
        "the background that was learned at {} is used; where the scene has changed since, clear it and "
        "`kinevox learn-background`",
        when(session.cameras.front().background)));
    return *std::move(pictures);
}

void StoredBackground::store(std::vector<Camera> cameras, double fps, EmptyScene pictures) {
    if (folder_.empty() || !pictures || pictures->size() != cameras.size() || pictures->front().empty())
        return;
    if (pictures->front().front().data.get() == restored_) return;
    writer_ = {};  // gives the one before up
    writer_ = std::jthread([this, cameras = std::move(cameras), fps,
                            pictures = std::move(pictures)](const std::stop_token& stop) mutable {
        const absl::Status written = write(cameras, fps, *pictures, stop);
        pictures.reset();
        if (!written.ok() && !stop.stop_requested())
            tell_(fmt::format(
                "the background is not stored, so that it must be learned again after a restart: {}",
                std::string(written.message())));
    });
}

// Written aside: what lies in the folder is whole. A crash between the two renames leaves none there, and it
// is learned anew.
absl::Status StoredBackground::write(const std::vector<Camera>& cameras, double fps,
                                     const std::vector<std::vector<Picture>>& pictures,
                                     const std::stop_token& stop) const {
    const fs::path aside = beside(folder_, ".part"), old = beside(folder_, ".old");
    std::error_code error;
    fs::remove_all(aside, error);
    fs::create_directories(aside, error);
    if (error) return absl::UnavailableError(fmt::format("{}: {}", aside.string(), error.message()));
    const auto files = write_empty_scene(aside, cameras, fps, pictures, stop);
    if (!files.ok()) return files.status();
    fs::remove_all(old, error);
    fs::rename(folder_, old, error);  // absent the first time
    fs::rename(aside, folder_, error);
    if (error) return absl::UnavailableError(fmt::format("{}: {}", folder_.string(), error.message()));
    fs::remove_all(old, error);
    return absl::OkStatus();
}

}  // namespace kinevox
