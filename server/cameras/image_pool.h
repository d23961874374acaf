// A pool of buffers of one size; a buffer returns when its last owner releases it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

namespace kinevox {

// Padding after an image: SIMD code, libswscale in particular, may access this many bytes beyond the end.
inline constexpr std::size_t kImagePaddingBytes = 64;

// Thread-safe. Buffers may outlive the pool. Keeps at most `max_idle` unused buffers. Each has
// kImagePaddingBytes bytes of padding.
class ImagePool {
  public:
    explicit ImagePool(std::size_t bytes, std::size_t max_idle = 32);

    std::shared_ptr<std::uint8_t[]> take();
    std::size_t bytes() const;

  private:
    struct Shelf;
    std::shared_ptr<Shelf> shelf_;
};

}  // namespace kinevox
