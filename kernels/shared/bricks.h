// Bit arithmetic on bricks: neighbours and surfaces without visiting voxels.
#pragma once

#include <cstdint>

#include "kernels/shared/device.h"
#include "kernels/types.h"

namespace kinevox::kernels {

// The occupancy of a brick and of its six neighbours (null: empty).
struct BrickNeighbours {
    const std::uint64_t* self = nullptr;
    const std::uint64_t* side[6] = {};  // -x, +x, -y, +y, -z, +z
};

inline constexpr std::uint64_t kFirstColumn = 0x0101010101010101u;  // x == 0 of every row
inline constexpr std::uint64_t kLastColumn = 0x8080808080808080u;   // x == 7

// Slice k, each voxel replaced by its neighbour in direction 0..5 (-x, +x, -y, +y, -z, +z).
KINEVOX_HD inline std::uint64_t neighbour_slice(const BrickNeighbours& b, int k, int direction) {
    const std::uint64_t own = b.self[k];
    const std::uint64_t* side = b.side[direction];
    const std::uint64_t beyond = side ? side[direction == 4 ? kBrickEdge - 1 : (direction == 5 ? 0 : k)] : 0;
    switch (direction) {
        case 0:
            return ((own << 1) & ~kFirstColumn) | ((beyond >> 7) & kFirstColumn);
        case 1:
            return ((own >> 1) & ~kLastColumn) | ((beyond << 7) & kLastColumn);
        case 2:
            return (own << 8) | (beyond >> 56);
        case 3:
            return (own >> 8) | (beyond << 56);
        case 4:
            return k > 0 ? b.self[k - 1] : beyond;
        default:
            return k < kBrickEdge - 1 ? b.self[k + 1] : beyond;
    }
}

// Occupied voxels of slice k with at least one empty neighbour of six.
KINEVOX_HD inline std::uint64_t surface_slice(const BrickNeighbours& b, int k) {
    std::uint64_t inner = b.self[k];
    if (inner == 0) return 0;
    for (int direction = 0; direction < 6; ++direction) inner &= neighbour_slice(b, k, direction);
    return b.self[k] & ~inner;
}

}  // namespace kinevox::kernels
