// The images from which the background was learned, on disk for the next recording.
#pragma once

#include <absl/status/statusor.h>

#include <condition_variable>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <stop_token>
#include <thread>
#include <vector>

#include "common/camera.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

// Per camera its images of the background.
using BackgroundImages = std::shared_ptr<const std::vector<std::vector<Image>>>;

// Writes per camera `folder`/NAME.mkv, lossless, and its index, replacing existing ones; returns the videos.
// Cancelled if a stop was requested.
absl::StatusOr<std::vector<std::filesystem::path>> write_background_videos(
    const std::filesystem::path& folder, const std::vector<Camera>& cameras, double fps,
    const std::vector<std::vector<Image>>& images, const std::stop_token& stop);

// Any thread.
class BackgroundClip {
  public:
    // Uses a hidden folder below `folder`, owned by this process, and removes those of dead processes.
    // Creates nothing before the first store(). `on_written`: files() has changed; called on the writing
    // thread.
    BackgroundClip(std::filesystem::path folder, std::function<void()> on_written);
    ~BackgroundClip();  // removes its files

    // Writes it, lossless, on a thread of its own, replacing the one before. At normal priority: recordings
    // need it, and on a busy machine a low-priority thread would take a minute for its second of work.
    void store(std::vector<Camera> cameras, double fps, BackgroundImages images);

    // Per camera its video, with its index next to it. Empty if there is none, it could not be written, or it
    // is being written and `wait` is false. Valid until the next store().
    std::vector<std::filesystem::path> files(bool wait);

  private:
    void write(const std::vector<Camera>& cameras, double fps, const std::vector<std::vector<Image>>& images,
               const std::stop_token& stop);

    const std::filesystem::path folder_;
    const std::function<void()> on_written_;
    std::mutex mutex_;
    std::condition_variable changed_;
    bool writing_ = false;
    std::vector<std::filesystem::path> files_;
    struct Lock;
    std::unique_ptr<Lock> lock_;  // shows other processes that this one is alive
    std::jthread thread_;
};

}  // namespace kinevox
