// JPEG in, PNG out.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <span>

#include "client/lib/client.h"

namespace kinevox::client {

// R G B, or grey where the JPEG is. InvalidArgument for an incomplete or invalid JPEG.
absl::StatusOr<Image> decode_jpeg(std::span<const std::uint8_t> bytes);

// Written atomically (temporary file, rename). Unavailable, naming the file, if that fails.
absl::Status write_png(const Image& image, const std::filesystem::path& file);

}  // namespace kinevox::client
