// The colours of a volume's surface voxels as three byte strings of prediction errors. docs/volume_format.md
// describes them.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/volume.h"
#include "common/volume_bits.h"

namespace kinevox {

// One byte a surface voxel each, in the order of Volume::colours.
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
