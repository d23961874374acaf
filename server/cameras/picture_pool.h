// Buffers of one size, used again and again: a picture's memory returns here when its last holder lets go.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>

namespace kinevox {

// Vector code, libswscale's above all, may touch so many bytes behind a picture: what it is given has them.
inline constexpr std::size_t kBytesBehindPicture = 64;

// Thread safe. Buffers may outlive the pool. Keeps at most `keep` idle buffers, frees the rest. Behind each
// there are kBytesBehindPicture more.
class PicturePool {
  public:
    explicit PicturePool(std::size_t bytes, std::size_t keep = 32);

    std::shared_ptr<std::uint8_t[]> take();
    std::size_t bytes() const;

  private:
    struct Shelf;
    std::shared_ptr<Shelf> shelf_;
};

}  // namespace kinevox
