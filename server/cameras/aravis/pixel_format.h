// Converts the pixel formats of machine-vision cameras.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>

#include "server/cameras/frame_source.h"
#include "server/cameras/image_pool.h"

namespace kinevox {

// Supported GenICam pixel formats (PFNC codes): Mono, BayerRG, GR, GB, BG with 8, 10, 12 bits, unpacked and
// both packings, RGB8, BGR8. Of more than 8 bits the upper 8 are used.
bool is_known_pixel_format(std::uint32_t format);
inline constexpr char kKnownPixelFormats[] =
    "Mono and Bayer with 8, 10 or 12 bits, packed or not, RGB8 and BGR8";

// Size of an image in bytes; 0 for an unknown format.
std::size_t image_bytes(std::uint32_t format, int width, int height);

// Writes B G R, 3 * width * height bytes, to `out`; grey becomes three equal channels, since the pipeline
// works on colours. InvalidArgument for an unknown format or too few bytes.
absl::Status to_bgr(std::uint32_t format, std::span<const std::uint8_t> bytes, int width, int height,
                    std::uint8_t* out);

}  // namespace kinevox
