#include "common/volume.h"
#include "common/volume_codec.h"

namespace kinevox {
namespace {

using volume_bits::morton_from_slice;
using volume_bits::slice_from_morton;

// Seven bits a byte, least first, the top bit set where another byte follows.
void append_varint(std::vector<std::uint8_t>& out, std::uint64_t value) {
    for (; value >= 0x80; value >>= 7) out.push_back(static_cast<std::uint8_t>(value | 0x80));
    out.push_back(static_cast<std::uint8_t>(value));
}

// Reads a byte string from its front; past the end it yields zeros and says so.
class ByteReader {
  public:
    explicit ByteReader(std::span<const std::uint8_t> bytes)
        : next_(bytes.data()), end_(next_ + bytes.size()) {}
    std::uint8_t byte() {
        if (next_ == end_) {
            overrun_ = true;
            return 0;
        }
        return *next_++;
    }
    std::uint64_t varint() {
        std::uint64_t value = 0;
        for (int shift = 0; shift < 63; shift += 7) {
            const std::uint64_t part = byte();
            value |= (part & 0x7f) << shift;
            if (part < 0x80) return value;
        }
        overrun_ = true;
        return 0;
    }
    bool overrun() const { return overrun_; }
    bool finished() const { return !overrun_ && next_ == end_; }

  private:
    const std::uint8_t* next_;
    const std::uint8_t* end_;
    bool overrun_ = false;
};

// The 16 bits of octant column `quarter` (y2 x2) in the four slices from z on.
struct Octant {
    std::array<std::uint16_t, 4> slices;

    std::uint8_t cell(int c) const {
        const int z = c >> 2 << 1, shift = (c & 3) * 4;
        return static_cast<std::uint8_t>((slices[z] >> shift & 15) | (slices[z + 1] >> shift & 15) << 4);
    }
    void set_cell(int c, std::uint8_t voxels) {
        const int z = c >> 2 << 1, shift = (c & 3) * 4;
        slices[z] = static_cast<std::uint16_t>(slices[z] | (voxels & 15) << shift);
        slices[z + 1] = static_cast<std::uint16_t>(slices[z + 1] | voxels >> 4 << shift);
    }
};

void encode_octant(const Octant& octant, ShapeSections& out) {
    unsigned not_empty = 0, full = 0;
    for (int c = 0; c < 8; ++c) {
        const std::uint8_t voxels = octant.cell(c);
        if (voxels != 0) not_empty |= 1u << c;
        if (voxels == 0xff) full |= 1u << c;
        if (voxels != 0 && voxels != 0xff) out.cells.push_back(voxels);
    }
    out.octants.push_back(static_cast<std::uint8_t>(not_empty));
    out.octants.push_back(static_cast<std::uint8_t>(full));
}

void encode_brick(const VolumeBrick& brick, ShapeSections& out) {
    BrickBits morton;
    for (int z = 0; z < 8; ++z) morton[z] = morton_from_slice(brick.occupancy[z]);
    unsigned not_empty = 0, full = 0;
    for (int o = 0; o < 8; ++o) {
        const int z = o >> 2 << 2, shift = (o & 3) * 16;
        Octant octant;
        for (int i = 0; i < 4; ++i) octant.slices[i] = static_cast<std::uint16_t>(morton[z + i] >> shift);
        const auto& s = octant.slices;
        const bool is_empty = (s[0] | s[1] | s[2] | s[3]) == 0;
        const bool is_full = (s[0] & s[1] & s[2] & s[3]) == 0xffff;
        if (!is_empty) not_empty |= 1u << o;
        if (is_full) full |= 1u << o;
        if (!is_empty && !is_full) encode_octant(octant, out);
    }
    out.bricks.push_back(static_cast<std::uint8_t>(not_empty));
    out.bricks.push_back(static_cast<std::uint8_t>(full));
}

// False for masks that no octant has.
bool decode_octant(ByteReader& octants, ByteReader& cells, Octant& octant) {
    const unsigned not_empty = octants.byte(), full = octants.byte();
    if ((full & ~not_empty) != 0 || not_empty == 0 || full == 0xff) return false;
    octant.slices = {};
    for (int c = 0; c < 8; ++c) {
        if (!(not_empty >> c & 1)) continue;
        const bool is_full = full >> c & 1;
        const std::uint8_t voxels = is_full ? 0xff : cells.byte();
        if (!is_full && (voxels == 0 || voxels == 0xff)) return false;
        octant.set_cell(c, voxels);
    }
    return true;
}

bool decode_brick(ByteReader& bricks, ByteReader& octants, ByteReader& cells, VolumeBrick& brick) {
    const unsigned not_empty = bricks.byte(), full = bricks.byte();
    if ((full & ~not_empty) != 0 || not_empty == 0) return false;
    BrickBits morton{};
    for (int o = 0; o < 8; ++o) {
        if (!(not_empty >> o & 1)) continue;
        Octant octant{{0xffff, 0xffff, 0xffff, 0xffff}};
        if (!(full >> o & 1) && !decode_octant(octants, cells, octant)) return false;
        const int z = o >> 2 << 2, shift = (o & 3) * 16;
        for (int i = 0; i < 4; ++i) morton[z + i] |= static_cast<std::uint64_t>(octant.slices[i]) << shift;
    }
    for (int z = 0; z < 8; ++z) brick.occupancy[z] = slice_from_morton(morton[z]);
    return true;
}

}  // namespace

ShapeSections encode_shape(const Volume& volume) {
    const std::int64_t nx = volume.grid.size[0] / 8, ny = volume.grid.size[1] / 8;
    ShapeSections out;
    out.bricks.reserve(2 * volume.bricks.size());
    out.octants.reserve(8 * volume.bricks.size());
    out.cells.reserve(16 * volume.bricks.size());
    std::int64_t next_slot = 0;
    for (const VolumeBrick& brick : volume.bricks) {
        const std::int64_t slot = (brick.z * ny + brick.y) * nx + brick.x;
        append_varint(out.gaps, static_cast<std::uint64_t>(slot - next_slot));
        next_slot = slot + 1;
        encode_brick(brick, out);
    }
    return out;
}

std::string decode_shape(const ShapeBytes& sections, std::size_t brick_count, Volume& volume) {
    const std::uint64_t nx = volume.grid.size[0] / 8, ny = volume.grid.size[1] / 8,
                        nz = volume.grid.size[2] / 8;
    const std::uint64_t brick_slots = nx * ny * nz;  // below 2^45
    ByteReader gaps(sections.gaps), bricks(sections.bricks), octants(sections.octants), cells(sections.cells);
    volume.bricks.resize(brick_count);
    std::uint64_t next_slot = 0;
    for (VolumeBrick& brick : volume.bricks) {
        const std::uint64_t gap = gaps.varint();
        if (gap >= brick_slots - next_slot) return "a brick lies outside the grid";
        const std::uint64_t slot = next_slot + gap;
        next_slot = slot + 1;
        brick.x = static_cast<std::int16_t>(slot % nx);
        brick.y = static_cast<std::int16_t>(slot / nx % ny);
        brick.z = static_cast<std::int16_t>(slot / nx / ny);
        if (!decode_brick(bricks, octants, cells, brick)) return "an octree mask contradicts itself";
    }
    if (!gaps.finished() || !bricks.finished() || !octants.finished() || !cells.finished())
        return "the sections of the shape do not have the length that the shape needs";
    return "";
}

}  // namespace kinevox
