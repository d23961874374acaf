// The wire form of a volume. docs/volume_format.md documents it byte for byte.
#pragma once

#include <absl/status/statusor.h>

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

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

// Internal, for the codec's own files: the parts of the wire form.

// The shape of a volume as four byte strings: where the bricks are, and each brick as an octree of three
// levels whose branches end where everything is empty or full. docs/volume_format.md describes them byte for
// byte.
struct ShapeSections {
    std::vector<std::uint8_t> gaps;     // between bricks, variable length
    std::vector<std::uint8_t> bricks;   // 2 a brick: which 4^3 octants are not empty, which are full
    std::vector<std::uint8_t> octants;  // 2 an octant that is neither: the same of its 2^3 cells
    std::vector<std::uint8_t> cells;    // 1 a cell that is neither: its voxels
};

// The volume must have no volume_problem().
ShapeSections encode_shape(const Volume& volume);

struct ShapeBytes {
    std::span<const std::uint8_t> gaps, bricks, octants, cells;
};

// The reverse; `brick_count` must not exceed kMaxBricks. Returns what is wrong, empty if nothing is.
std::string decode_shape(const ShapeBytes& sections, std::size_t brick_count, Volume& volume);

// The colours of a volume's surface voxels as three byte strings of prediction errors, which
// docs/volume_format.md describes. One byte a surface voxel each, in the order of Volume::colours.
struct ColourSections {
    std::vector<std::uint8_t> luma, orange, green;  // Y, Co, Cg
};

// One colour for each set bit of `surface`.
ColourSections encode_colours(std::span<const BrickBits> surface, std::span<const Rgb> colours);

struct ColourBytes {
    std::span<const std::uint8_t> luma, orange, green;
};

// The reverse; each of the three has one byte for each set bit of `surface`. False if a colour is out of
// range.
bool decode_colours(const ColourBytes& sections, std::span<const BrickBits> surface,
                    std::vector<Rgb>& colours);

}  // namespace kinevox
