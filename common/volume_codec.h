// The wire form of a volume. docs/volume_format.md documents it byte for byte.
#pragma once

#include <absl/status/statusor.h>

#include <span>
#include <string>

#include "common/volume.h"

namespace kinevox {

struct VolumeCodecOptions {
    bool with_colours = true;
    int zstd_level = 1;
};

// A surface with more voxels has no colours: 16 million colours are 50 MB.
inline constexpr std::size_t kMaxCodedColours = 1 << 24;

// The shape is kept exactly, each colour channel to within 2 of 255 levels (see Rgb's coding in
// docs/volume_format.md). Empty for a volume with a volume_problem(). Colours are omitted unless there is one
// per surface voxel.
std::string encode_volume(const Volume& volume, const VolumeCodecOptions& options = {});

// InvalidArgument for anything that encode_volume() could not have written; never reads past `bytes`. The
// header's sizes are checked before anything is allocated: at most about 350 MB, whatever the bytes claim.
absl::StatusOr<Volume> decode_volume(std::span<const std::uint8_t> bytes);

}  // namespace kinevox
