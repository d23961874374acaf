// The background that live cameras showed, kept over a restart of the daemon.
#pragma once

#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "server/cameras/frame_source.h"
#include "server/recording/empty_scene_files.h"

namespace kinevox {

// store() and the sources' background() by one thread at a time.
class StoredBackground {
  public:
    using Tell = std::function<void(const std::string&)>;

    // `folder` empty: nothing is stored. `tell` comes from this class's own thread, too.
    StoredBackground(std::filesystem::path folder, Tell tell);
    ~StoredBackground();  // what is being written is given up, what was stored before stays

    // Behind the caller, in place of the one before; not one that came from here.
    void store(std::vector<Camera> cameras, double fps, EmptyScene pictures);

    // The same source, with the stored background where it has none of its own and that one fits its cameras.
    // This object must outlive it.
    std::unique_ptr<FrameSource> restoring(std::unique_ptr<FrameSource> source);

    // Of these cameras; empty where none is stored or it does not fit.
    std::vector<std::vector<Picture>> read(const std::vector<Camera>& cameras);

  private:
    absl::Status write(const std::vector<Camera>& cameras, double fps,
                       const std::vector<std::vector<Picture>>& pictures, const std::stop_token& stop) const;

    const std::filesystem::path folder_;
    const Tell tell_;
    const void* restored_ = nullptr;  // the first of the pictures that were read
    std::jthread writer_;
};

}  // namespace kinevox
