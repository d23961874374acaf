// The pictures that the background was learned from, kept on disk until a recording wants them.
#pragma once

#include <condition_variable>
#include <filesystem>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "common/camera.h"
#include "server/recording/empty_scene_files.h"

namespace kinevox {

// Any thread.
class BackgroundClip {
  public:
    // Lies in a hidden folder below `folder`, of this process alone; removes those of processes that are
    // gone. Nothing is made before the first keep(). `on_written`: files() has news; on the writing thread.
    BackgroundClip(std::filesystem::path folder, std::function<void()> on_written);
    ~BackgroundClip();  // removes its files

    // Writes it, lossless, on a thread of its own; takes the place of the one before. At normal priority: a
    // recording is of little use without it, and on a busy machine a lowered thread would take a minute for
    // its second of work.
    void keep(std::vector<Camera> cameras, double fps, EmptyScene pictures);

    // Per camera its video, with its index beside it. Empty where none is kept, it could not be written, or
    // is being written and nobody waits for that. Valid until the next keep().
    std::vector<std::filesystem::path> files(bool wait);

  private:
    void write(const std::vector<Camera>& cameras, double fps,
               const std::vector<std::vector<Picture>>& pictures, const std::stop_token& stop);

    const std::filesystem::path folder_;
    const std::function<void()> on_written_;
    std::mutex mutex_;
    std::condition_variable changed_;
    bool writing_ = false;
    std::vector<std::filesystem::path> files_;
    struct Lock;
    std::unique_ptr<Lock> lock_;  // tells other processes that this one lives
    std::jthread thread_;
};

}  // namespace kinevox
