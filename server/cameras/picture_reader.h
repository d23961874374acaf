// One camera's recorded pictures, one after the other: a video or a folder of pictures.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>

#include "server/cameras/frame_source.h"

namespace kinevox {

// Used by one thread at a time.
class PictureReader {
  public:
    virtual ~PictureReader() = default;

    // Pictures the file promises; -1 if it does not say.
    virtual std::int64_t promised() const = 0;
    // True: promised() is exact (a folder, an index in the container), false: an estimate from length and
    // rate.
    virtual bool promise_is_exact() const = 0;
    // How many there are. Where promised() is not exact, the file is read through once, without decoding it.
    virtual absl::StatusOr<std::int64_t> count() { return promised(); }

    // The next picture, B G R. OutOfRange behind the last one; InvalidArgument for a picture that cannot be
    // decoded or has another size than the camera.
    virtual absl::StatusOr<Picture> next() = 0;

    // next() will deliver that one, exactly. OutOfRange behind the last one, as far as that is known before.
    virtual absl::Status seek(std::int64_t frame) = 0;

    // Back to the first picture.
    virtual absl::Status rewind() = 0;
};

// `camera` names the camera in messages and fixes the size that every picture must have. NotFound if there is
// no such file, InvalidArgument if it holds no readable picture or pictures of another size. A single picture
// file counts as a clip of one.
absl::StatusOr<std::unique_ptr<PictureReader>> open_pictures(const std::filesystem::path& file,
                                                             const Camera& camera);

// What such an error says: `file` has pictures of width x height px.
absl::Status wrong_size(const Camera& camera, const std::filesystem::path& file, int width, int height);

}  // namespace kinevox
