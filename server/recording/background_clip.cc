#include "server/recording/background_clip.h"

#include <fmt/format.h>
#include <unistd.h>

#include <cmath>
#include <system_error>
#include <utility>

#include "common/recording_files.h"
#include "server/recording/growing_files.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;

constexpr const char* kPrefix = ".background-";

}  // namespace

absl::StatusOr<std::vector<fs::path>> write_background_videos(const fs::path& folder,
                                                              const std::vector<Camera>& cameras, double fps,
                                                              const std::vector<std::vector<Image>>& images,
                                                              const std::stop_token& stop) {
    std::vector<fs::path> files;
    std::error_code error;
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        const fs::path video = folder / (cameras[c].name + ".mkv");
        fs::remove(video, error);  // a recording may have a hard link to the old one
        fs::remove(video_index_file(video), error);
        auto encoder = ImageEncoder::create(cameras[c], fps, VideoCodec::kUtVideo);
        if (!encoder.ok()) return encoder.status();
        auto file = VideoFile::create(video, (*encoder)->format());
        if (!file.ok()) return file.status();
        for (std::size_t n = 0; n < images[c].size(); ++n) {
            if (stop.stop_requested())
                return absl::CancelledError("superseded: the background was learned again");
            const auto encoded = (*encoder)->encode(images[c][n], true);
            if (!encoded.ok()) return encoded.status();
            const auto time_ns = std::llround(1e9 * static_cast<double>(n) / fps);
            if (const absl::Status written = (*file)->append(**encoded, time_ns); !written.ok())
                return written;
        }
        (*file)->close().IgnoreError();
        files.push_back(video);
    }
    return files;
}

struct BackgroundClip::Lock {
    AppendFile file;
};

BackgroundClip::BackgroundClip(fs::path folder, std::function<void()> on_written)
    : folder_(std::move(folder)), on_written_(std::move(on_written)) {
    std::error_code error;
    if (folder_.empty()) return;
    for (const auto& entry : fs::directory_iterator(folder_, error)) {
        if (!entry.path().filename().string().starts_with(kPrefix)) continue;
        std::error_code ignored;
        if (!being_written(entry.path() / "lock")) fs::remove_all(entry.path(), ignored);
    }
}

BackgroundClip::~BackgroundClip() {
    thread_ = {};  // asks it to stop and joins it
    if (!lock_) return;
    std::error_code ignored;
    fs::remove_all(lock_->file.path().parent_path(), ignored);
}

void BackgroundClip::store(std::vector<Camera> cameras, double fps, BackgroundImages images) {
    if (folder_.empty() || !images || images->size() != cameras.size()) return;
    thread_ = {};
    {
        const std::scoped_lock lock(mutex_);
        writing_ = true;
        files_.clear();
    }
    thread_ = std::jthread([this, cameras = std::move(cameras), fps,
                            images = std::move(images)](const std::stop_token& stop) mutable {
        write(cameras, fps, *images, stop);
        images.reset();
        {
            const std::scoped_lock lock(mutex_);
            writing_ = false;
            changed_.notify_all();
        }
        if (!stop.stop_requested()) on_written_();
    });
}

void BackgroundClip::write(const std::vector<Camera>& cameras, double fps,
                           const std::vector<std::vector<Image>>& images, const std::stop_token& stop) {
    const fs::path own = folder_ / fmt::format("{}{}", kPrefix, getpid());
    std::error_code error;
    fs::create_directories(own, error);
    if (!lock_) {
        auto made = AppendFile::create(own / "lock");
        if (!made.ok() || !made->lock()) return;
        lock_ = std::make_unique<Lock>(Lock{*std::move(made)});
    }
    auto files = write_background_videos(own, cameras, fps, images, stop);
    if (!files.ok()) return;
    const std::scoped_lock lock(mutex_);
    files_ = *std::move(files);
}

std::vector<fs::path> BackgroundClip::files(bool wait) {
    std::unique_lock lock(mutex_);
    if (wait) changed_.wait(lock, [this] { return !writing_; });
    return files_;
}

}  // namespace kinevox
