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

fs::path sibling(const fs::path& folder, const char* suffix) {
    return fs::path(folder.string() + suffix);
}

std::string write_time(const fs::path& file) {
    std::error_code error;
    const auto time = fs::last_write_time(file, error);
    if (error) return "an unknown date";
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
    absl::StatusOr<std::vector<std::vector<Image>>> background() override {
        auto own = source_->background();
        if (!own.ok() || !own->empty()) return own;
        return stored_.read(source_->cameras());
    }
    absl::StatusOr<FrameSet> next() override { return source_->next(); }
    void stop() override { source_->stop(); }
    std::vector<CameraConnection> camera_connections() const override {
        return source_->camera_connections();
    }
    void set_on_camera_event(OnCameraEvent on_event) override {
        source_->set_on_camera_event(std::move(on_event));
    }

  private:
    const std::unique_ptr<FrameSource> source_;
    StoredBackground& stored_;
};

}  // namespace

StoredBackground::StoredBackground(fs::path folder, OnMessage on_message)
    : folder_(std::move(folder)), on_message_(std::move(on_message)) {}

StoredBackground::~StoredBackground() = default;

std::unique_ptr<FrameSource> StoredBackground::restoring(std::unique_ptr<FrameSource> source) {
    if (folder_.empty()) return source;
    return std::make_unique<RestoringSource>(std::move(source), *this);
}

std::vector<std::vector<Image>> StoredBackground::read(const std::vector<Camera>& cameras) {
    Session session;
    session.recording.emplace();  // all images are used
    std::error_code error;
    if (folder_.empty() || !fs::is_directory(folder_, error)) return {};
    for (const Camera& camera : cameras) {
        const fs::path video = folder_ / (camera.name + ".mkv");
        if (!fs::exists(video, error)) {
            on_message_(
                fmt::format("stored background {} does not match the cameras (missing: {}); relearn it",
                            folder_.string(), camera.name));
            return {};
        }
        session.cameras.push_back({camera.name, {}, video});
    }
    auto images = read_backgrounds(session, cameras);
    if (!images.ok()) {
        on_message_(fmt::format("the stored background cannot be used: {}; relearn it",
                                std::string(images.status().message())));
        return {};
    }
    if (images->empty() || images->front().empty()) return {};
    restored_ = images->front().front().data.get();
    on_message_(
        fmt::format("using the background learned at {}; relearn it if the scene has changed (`kinevox "
                    "learn-background`)",
                    write_time(session.cameras.front().background)));
    return *std::move(images);
}

void StoredBackground::store(std::vector<Camera> cameras, double fps, BackgroundImages images) {
    if (folder_.empty() || !images || images->size() != cameras.size() || images->front().empty()) return;
    if (images->front().front().data.get() == restored_) return;
    writer_ = {};  // cancels the previous one
    writer_ = std::jthread([this, cameras = std::move(cameras), fps,
                            images = std::move(images)](const std::stop_token& stop) mutable {
        const absl::Status written = write(cameras, fps, *images, stop);
        images.reset();
        if (!written.ok() && !stop.stop_requested())
            on_message_(
                fmt::format("the background cannot be stored and must be relearned after a restart: {}",
                            std::string(written.message())));
    });
}

// Written to a sibling folder and renamed: the folder is always complete. A crash between the two renames
// leaves none, and the background is relearned.
absl::Status StoredBackground::write(const std::vector<Camera>& cameras, double fps,
                                     const std::vector<std::vector<Image>>& images,
                                     const std::stop_token& stop) const {
    const fs::path partial = sibling(folder_, ".part"), old = sibling(folder_, ".old");
    std::error_code error;
    fs::remove_all(partial, error);
    fs::create_directories(partial, error);
    if (error) return absl::UnavailableError(fmt::format("{}: {}", partial.string(), error.message()));
    const auto files = write_background_videos(partial, cameras, fps, images, stop);
    if (!files.ok()) return files.status();
    fs::remove_all(old, error);
    fs::rename(folder_, old, error);  // absent the first time
    fs::rename(partial, folder_, error);
    if (error) return absl::UnavailableError(fmt::format("{}: {}", folder_.string(), error.message()));
    fs::remove_all(old, error);
    return absl::OkStatus();
}

}  // namespace kinevox
