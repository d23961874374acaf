// Stores the background of live cameras for the next start of the daemon.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/cameras/frame_source.h"
#include "server/recording/background_clip.h"

namespace kinevox {

// store() and the sources' background() by one thread at a time.
class StoredBackground {
  public:
    using OnMessage = std::function<void(const std::string&)>;

    // `folder` empty: nothing is stored. `on_message` is called from this class's own thread, too.
    StoredBackground(std::filesystem::path folder, OnMessage on_message);
    ~StoredBackground();  // cancels writing; what was stored before stays

    // In the background; replaces the previous one. Ignores one that was read from here.
    void store(std::vector<Camera> cameras, double fps, BackgroundImages images);

    // The same source, with the stored background if it has none and the stored one matches its cameras. This
    // object must outlive it.
    std::unique_ptr<FrameSource> restoring(std::unique_ptr<FrameSource> source);

    // Of these cameras; empty if none is stored or it does not match.
    std::vector<std::vector<Image>> read(const std::vector<Camera>& cameras);

  private:
    absl::Status write(const std::vector<Camera>& cameras, double fps,
                       const std::vector<std::vector<Image>>& images, const std::stop_token& stop) const;

    const std::filesystem::path folder_;
    const OnMessage on_message_;
    const void* restored_ = nullptr;  // the first image that was read
    std::jthread writer_;
};

}  // namespace kinevox
