#include "server/pose/main_body.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "kernels/projection.h"
#include "server/silhouettes/mask_box.h"

namespace kinevox {
namespace {

constexpr float kBelowFloor_m = 0.06f;
constexpr float kBeside_m = 0.2f;  // horizontal margin around the largest component for others of the subject

// Components of which at least half is above or below the largest one: a gap in between (trousers similar to
// the floor) may separate them.
std::vector<char> components_of_subject(const kernels::Lattice& lattice, const std::vector<int>& component,
                                        int component_count, int largest) {
    const int nx = lattice.size[0], ny = lattice.size[1],
              margin = static_cast<int>(std::lround(kBeside_m / lattice.voxel_m));
    const std::size_t columns = static_cast<std::size_t>(nx) * ny;
    std::vector<char> footprint(columns, 0);
    for (std::size_t k = 0; k < component.size(); ++k) {
        if (component[k] != largest) continue;
        const int x = static_cast<int>(k % columns) % nx, y = static_cast<int>(k % columns) / nx;
        if (footprint[k % columns] == 2) continue;
        footprint[k % columns] = 2;
        for (int j = std::max(0, y - margin); j <= std::min(ny - 1, y + margin); ++j)
            for (int i = std::max(0, x - margin); i <= std::min(nx - 1, x + margin); ++i) {
                char& cell = footprint[static_cast<std::size_t>(j) * nx + i];
                if (cell == 0) cell = 1;
            }
    }
    std::vector<std::int64_t> over(component_count + 1, 0), all(component_count + 1, 0);
    for (std::size_t k = 0; k < component.size(); ++k) {
        if (component[k] <= 0) continue;
        ++all[component[k]];
        over[component[k]] += footprint[k % columns] != 0;
    }
    std::vector<char> kept(component_count + 1, 0);
    for (int p = 1; p <= component_count; ++p) kept[p] = 2 * over[p] >= all[p];
    return kept;
}

// Of the size of `seen`, nothing set.
void clear_for(const kernels::Silhouettes& seen, kernels::Silhouettes& out) {
    out.probability.clear();
    if (out.width != seen.width || out.height != seen.height || out.sharp.size() != seen.sharp.size()) {
        out.width = seen.width, out.height = seen.height;
        out.sharp.assign(seen.sharp.size(), 0);
        out.loose.assign(seen.sharp.size(), 0);
        return;
    }
    clear_box(out.sharp, out.width, out.searched);
    clear_box(out.loose, out.width, out.searched);
}

}  // namespace

std::optional<MainBody> main_body(const kernels::VoxelVolume& coarse) {
    const kernels::Lattice& lattice = coarse.lattice;
    const int nx = lattice.size[0], ny = lattice.size[1], nz = lattice.size[2];
    const auto index = [&](int x, int y, int z) { return (static_cast<std::size_t>(z) * ny + y) * nx + x; };
    std::vector<int> component(static_cast<std::size_t>(nx) * ny * nz,
                               -1);  // -1: empty, 0: not visited, else the component's number
    for (const kernels::Brick& brick : coarse.bricks)
        for (int z = 0; z < kernels::kBrickEdge; ++z) {
            const int k = kernels::kBrickEdge * brick.z + z;
            if (lattice.origin[2] + (static_cast<float>(k) + 0.5f) * lattice.voxel_m < -kBelowFloor_m)
                continue;
            for (int bit = 0; bit < 64; ++bit)
                if (brick.occupancy[z] >> bit & 1)
                    component[index(kernels::kBrickEdge * brick.x + bit % 8,
                                    kernels::kBrickEdge * brick.y + bit / 8, k)] = 0;
        }
    int component_count = 0, largest = 0;
    std::size_t max_size = 0;
    std::vector<std::array<int, 3>> stack;
    for (int z = 0; z < nz; ++z)
        for (int y = 0; y < ny; ++y)
            for (int x = 0; x < nx; ++x) {
                if (component[index(x, y, z)] != 0) continue;
                std::size_t size = 0;
                component[index(x, y, z)] = ++component_count;
                stack.push_back({x, y, z});
                while (!stack.empty()) {
                    const auto at = stack.back();
                    stack.pop_back();
                    ++size;
                    for (int side = 0; side < 6; ++side) {
                        auto next = at;
                        next[side / 2] += side % 2 == 0 ? -1 : 1;
                        if (next[0] < 0 || next[1] < 0 || next[2] < 0 || next[0] >= nx || next[1] >= ny ||
                            next[2] >= nz)
                            continue;
                        int& there = component[index(next[0], next[1], next[2])];
                        if (there != 0) continue;
                        there = component_count;
                        stack.push_back(next);
                    }
                }
                if (size > max_size) max_size = size, largest = component_count;
            }
    if (max_size == 0) return std::nullopt;
    const std::vector<char> subject = components_of_subject(lattice, component, component_count, largest);
    MainBody body;
    body.volume.lattice = lattice;
    double sum[3] = {};
    std::int64_t voxels = 0;
    for (const kernels::Brick& brick : coarse.bricks) {
        kernels::Brick kept = brick;
        bool any = false;
        for (int z = 0; z < kernels::kBrickEdge; ++z) {
            kept.occupancy[z] = 0;
            for (int bit = 0; bit < 64; ++bit) {
                const int i = kernels::kBrickEdge * brick.x + bit % 8,
                          j = kernels::kBrickEdge * brick.y + bit / 8, k = kernels::kBrickEdge * brick.z + z;
                if (const int p = component[index(i, j, k)]; p <= 0 || !subject[p]) continue;
                kept.occupancy[z] |= std::uint64_t{1} << bit;
                sum[0] += i, sum[1] += j, sum[2] += k;
                ++voxels;
                any = true;
            }
        }
        if (any) body.volume.bricks.push_back(kept);
    }
    const auto centre = [&](int axis) {
        return lattice.origin[axis] + (sum[axis] / static_cast<double>(voxels) + 0.5) * lattice.voxel_m;
    };
    body.centre_in_world = {centre(0), centre(1), centre(2)};
    return body;
}

kernels::VoxelVolume inside_of(const kernels::VoxelVolume& fine, const kernels::VoxelVolume& coarse,
                               int factor) {
    const int bricks_x = coarse.lattice.size[0] / kernels::kBrickEdge,
              bricks_y = coarse.lattice.size[1] / kernels::kBrickEdge,
              bricks_z = coarse.lattice.size[2] / kernels::kBrickEdge;
    std::vector<const kernels::Brick*> at(static_cast<std::size_t>(bricks_x) * bricks_y * bricks_z, nullptr);
    for (const kernels::Brick& b : coarse.bricks)
        at[(static_cast<std::size_t>(b.z) * bricks_y + b.y) * bricks_x + b.x] = &b;
    kernels::VoxelVolume out;
    out.lattice = fine.lattice;
    for (const kernels::Brick& brick : fine.bricks) {
        kernels::Brick kept = brick;
        std::uint64_t any = 0;
        for (int z = 0; z < kernels::kBrickEdge; ++z) {
            std::uint64_t keep = 0;
            for (int bit = 0; bit < 64; ++bit) {
                if (!(brick.occupancy[z] >> bit & 1)) continue;
                const int i = (kernels::kBrickEdge * brick.x + bit % 8) / factor,
                          j = (kernels::kBrickEdge * brick.y + bit / 8) / factor,
                          k = (kernels::kBrickEdge * brick.z + z) / factor;
                const int bx = i / kernels::kBrickEdge, by = j / kernels::kBrickEdge,
                          bz = k / kernels::kBrickEdge;
                if (bx >= bricks_x || by >= bricks_y || bz >= bricks_z) continue;
                const kernels::Brick* b = at[(static_cast<std::size_t>(bz) * bricks_y + by) * bricks_x + bx];
                if (b && b->occupancy[k % 8] >> (8 * (j % 8) + i % 8) & 1) keep |= std::uint64_t{1} << bit;
            }
            kept.occupancy[z] = keep;
            any |= keep;
        }
        if (any) out.bricks.push_back(kept);
    }
    return out;
}

double fraction_outside(const kernels::Silhouettes& seen, const kernels::VoxelVolume& volume,
                        const kernels::CameraModel& camera, int dilate_px, std::vector<std::uint8_t>& mask) {
    if (seen.sharp_pixels <= 0 || seen.bounds.empty()) return 0;
    mask.resize(static_cast<std::size_t>(seen.width) * seen.height);
    const float still[3] = {0, 0, 0};
    kernels::Rect covered;
    kernels::project_volume(volume, camera, still, dilate_px, mask.data(), covered);
    std::int64_t inside = 0;
    for (int y = seen.bounds.y0; y < seen.bounds.y1; ++y) {
        const std::size_t row = static_cast<std::size_t>(y) * seen.width;
        for (int x = seen.bounds.x0; x < seen.bounds.x1; ++x) inside += seen.sharp[row + x] && mask[row + x];
    }
    return 1 - static_cast<double>(inside) / static_cast<double>(seen.sharp_pixels);
}

void apply_mask(const kernels::Silhouettes& seen, const std::vector<std::uint8_t>& mask,
                const kernels::Rect& box, kernels::Silhouettes& out) {
    clear_for(seen, out);
    out.searched = intersection_of(seen.bounds, box);
    out.sharp_pixels = 0;
    out.bounds = {seen.width, seen.height, 0, 0};
    std::int64_t sum_x = 0, sum_y = 0;
    const int width = out.searched.width();
    for (int y = out.searched.y0; y < out.searched.y1; ++y) {
        const std::size_t at = static_cast<std::size_t>(y) * seen.width + out.searched.x0;
        const std::uint8_t* const in = mask.data() + at;
        std::uint8_t *const sharp = out.sharp.data() + at, *const loose = out.loose.data() + at;
        int pixels = 0, columns = 0;  // and the sum of their columns
        for (int x = 0; x < width; ++x) {
            loose[x] = seen.loose[at + x] & in[x];
            sharp[x] = seen.sharp[at + x] & in[x];
            const int set = sharp[x] != 0;
            pixels += set;
            columns += set * x;
        }
        if (pixels == 0) continue;
        out.sharp_pixels += pixels;
        sum_x += std::int64_t{pixels} * out.searched.x0 + columns;
        sum_y += std::int64_t{pixels} * y;
        int first = 0, last = width - 1;
        while (!sharp[first]) ++first;
        while (!sharp[last]) --last;
        out.bounds.x0 = std::min(out.bounds.x0, out.searched.x0 + first);
        out.bounds.x1 = std::max(out.bounds.x1, out.searched.x0 + last + 1);
        out.bounds.y0 = std::min(out.bounds.y0, y), out.bounds.y1 = y + 1;
    }
    if (out.sharp_pixels > 0) {
        out.centroid_x = static_cast<double>(sum_x) / static_cast<double>(out.sharp_pixels);
        out.centroid_y = static_cast<double>(sum_y) / static_cast<double>(out.sharp_pixels);
    } else {
        out.bounds = {};
    }
}

}  // namespace kinevox
