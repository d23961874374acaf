// Plain types shared by all kernels: images, cameras, the lattice and the voxel volume. Without types of any
// library, so that this folder builds alone on a GPU machine.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "kernels/device.h"

namespace kinevox::kernels {

// A non-owning view of an image: 8 bits per channel, rows `stride` bytes apart, channels interleaved.
// 3 channels are B, G, R (OpenCV's order); 1 is grey.
struct ImageView {
    const std::uint8_t* data = nullptr;
    int width = 0;              // px
    int height = 0;             // px
    int channels = 0;           // 1 or 3
    std::ptrdiff_t stride = 0;  // bytes from one row to the next

    const std::uint8_t* row(int y) const { return data + y * stride; }
};

// Half open: x in [x0, x1), y in [y0, y1). Pixels.
struct Rect {
    int x0 = 0, y0 = 0, x1 = 0, y1 = 0;
    bool empty() const { return x1 <= x0 || y1 <= y0; }
    int width() const { return x1 - x0; }
    int height() const { return y1 - y0; }
    bool operator==(const Rect&) const = default;
};

// Without any pixel if they share none.
inline Rect intersection_of(const Rect& a, const Rect& b) {
    const Rect both{a.x0 > b.x0 ? a.x0 : b.x0, a.y0 > b.y0 ? a.y0 : b.y0, a.x1 < b.x1 ? a.x1 : b.x1,
                    a.y1 < b.y1 ? a.y1 : b.y1};
    return both.empty() ? Rect{} : both;
}

// The smallest that holds both, neither empty.
inline Rect union_of(const Rect& a, const Rect& b) {
    return {a.x0 < b.x0 ? a.x0 : b.x0, a.y0 < b.y0 ? a.y0 : b.y0, a.x1 > b.x1 ? a.x1 : b.x1,
            a.y1 > b.y1 ? a.y1 : b.y1};
}

// OpenCV's pinhole camera: x_camera = rotation * x_world + translation (metres; x right, y down, z forward),
// then distortion k1 k2 p1 p2 k3, then u = fx * x'' + cx. The first pixel's centre is (0, 0).
struct CameraModel {
    int width = 0, height = 0;             // px
    float fx = 0, fy = 0, cx = 0, cy = 0;  // px
    float k1 = 0, k2 = 0, p1 = 0, p2 = 0, k3 = 0;
    float rotation_camera_from_world[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1};  // row major
    float translation_camera_from_world[3] = {0, 0, 0};                 // m
};

inline constexpr int kBrickEdge = 8;  // voxels
inline constexpr int kBrickVoxels = kBrickEdge * kBrickEdge * kBrickEdge;

// An axis-aligned box of cubic voxels in the world frame. Voxel (i, j, k) spans
// origin + voxel_m * [i, i+1) x [j, j+1) x [k, k+1). Each size is a multiple of kBrickEdge.
struct Lattice {
    float origin[3] = {0, 0, 0};  // m, world, the corner with the smallest coordinates
    float voxel_m = 0.01f;
    int size[3] = {0, 0, 0};  // voxels along x, y, z

    bool operator==(const Lattice&) const = default;
};

// 8 x 8 x 8 voxels. Bit (y * 8 + x) of occupancy[z] is the voxel (x, y, z) of the brick, each 0..7.
struct Brick {
    std::int16_t x = 0, y = 0, z = 0;  // in bricks from the lattice's origin
    std::int16_t padding = 0;          // named, so that a GPU initialises all bytes that are copied
    std::uint64_t occupancy[kBrickEdge] = {};
};

struct Colour {
    std::uint8_t r = 0, g = 0, b = 0;
    bool operator==(const Colour&) const = default;
};

// A volume as non-empty bricks sorted by (z, y, x). A surface voxel is an occupied one with at least one of
// its six neighbours empty (outside the lattice counts as empty). `colours` has one entry per surface voxel,
// in the order of the bricks and, inside a brick, of z, y, x; it is empty for a volume without colours.
struct VoxelVolume {
    Lattice lattice;
    std::vector<Brick> bricks;
    std::vector<Colour> colours;
};

}  // namespace kinevox::kernels
