// From a machine-vision camera's pixels to ours.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "server/cameras/frame_source.h"
#include "server/cameras/picture_pool.h"

namespace kinevox {

// GenICam's pixel formats (PFNC numbers) that are understood: Mono, BayerRG, GR, GB, BG with 8, 10, 12 bits,
// unpacked and packed both ways, RGB8, BGR8. Of more than 8 bits the highest 8 count.
bool is_known_pixel_format(std::uint32_t format);
inline constexpr char kKnownPixelFormats[] =
    "Mono and Bayer with 8, 10 or 12 bits, packed or not, RGB8 and BGR8";

// The bytes a picture takes; 0 for an unknown format.
std::size_t picture_bytes(std::uint32_t format, int width, int height);

// Writes B G R, 3 * width * height bytes, into `out`; grey becomes three equal channels, since all behind
// this works on colours. InvalidArgument for an unknown format or too few bytes.
absl::Status to_bgr(std::uint32_t format, std::span<const std::uint8_t> bytes, int width, int height,
                    std::uint8_t* out);

}  // namespace kinevox
