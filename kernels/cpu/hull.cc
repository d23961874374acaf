// The carver on the CPU: maps of each silhouette, then super-blocks of 4^3 bricks, bricks, voxels. Each step
// is a parallel_for over small pieces with disjoint outputs, so that the result does not depend on the
// threads.
#include "kernels/cpu/hull.h"

#include <algorithm>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "kernels/cpu/hull_maps.h"
#include "kernels/cpu/parallel.h"
#include "kernels/cpu/surrounded.h"

namespace kinevox::kernels {
namespace {

constexpr int kSuperEdge = 4;  // bricks
constexpr int kBricksPerTask = 4;

class CpuHullCarver final : public HullCarver {
  public:
    explicit CpuHullCarver(const HullOptions& options) : options_(options) {}

    void carve(std::span<const HullView> views, const Lattice& lattice, VoxelVolume& out) override {
        check_lattice(lattice);
        out.lattice = lattice;
        out.bricks.clear();
        out.colours.clear();
        prepare_views(views, lattice);
        decide_bricks(lattice);
        list_bricks(out);
        carve_bricks(out);
        filler_.fill(out, options_.fill_radius_m, kFillLinesOfHull);
    }

  private:
    void prepare_views(std::span<const HullView> views, const Lattice& lattice) {
        present_.clear();
        for (const HullView& view : views) {
            if (view.camera && view.silhouette) present_.push_back(&view);
        }
        if (present_.size() > kMaxViews) {
            throw std::invalid_argument("hull: " + std::to_string(present_.size()) + " views; at most " +
                                        std::to_string(kMaxViews));
        }
        storage_.resize(std::max(storage_.size(), present_.size()));
        maps_.resize(present_.size());
        projectors_.clear();
        for (const HullView* view : present_)
            projectors_.push_back(make_projector(*view->camera, "hull: camera"));
        parallel_for(0, static_cast<int>(present_.size()), 1, [&](int first, int last) {
            for (int n = first; n < last; ++n) {
                const float half_edge = 0.5f * kBrickEdge * lattice.voxel_m;
                make_hull_maps(*present_[n], projectors_[n], options_.miss_budget_permille,
                               typical_block_radius_px(projectors_[n], lattice, half_edge), storage_[n]);
                maps_[n] = storage_[n].maps;
            }
        });
    }

    BlockState decide(const Lattice& lattice, int bx, int by, int bz, int edge,
                      std::uint64_t* inside = nullptr) const {
        const float voxel = lattice.voxel_m;
        const float half = 0.5f * static_cast<float>(edge * kBrickEdge) * voxel;
        const auto centre = [&](int axis, int brick) {
            return lattice.origin[axis] + static_cast<float>(brick * kBrickEdge) * voxel + half;
        };
        return decide_block(maps_.data(), static_cast<int>(maps_.size()), options_.min_views, centre(0, bx),
                            centre(1, by), centre(2, bz), half - 0.5f * voxel, inside);
    }

    void decide_bricks(const Lattice& lattice) {
        const int nx = lattice.size[0] / kBrickEdge, ny = lattice.size[1] / kBrickEdge,
                  nz = lattice.size[2] / kBrickEdge;
        states_.assign(static_cast<std::size_t>(nx) * ny * nz, BlockState::kEmpty);
        inside_.resize(states_.size());
        const auto blocks = [](int bricks) { return (bricks + kSuperEdge - 1) / kSuperEdge; };
        const int sx = blocks(nx), sy = blocks(ny), sz = blocks(nz);
        parallel_for(0, sx * sy * sz, 1, [&](int first, int last) {
            for (int n = first; n < last; ++n) {
                const int x0 = n % sx * kSuperEdge, y0 = n / sx % sy * kSuperEdge,
                          z0 = n / (sx * sy) * kSuperEdge;
                const BlockState whole = decide(lattice, x0, y0, z0, kSuperEdge);
                if (whole == BlockState::kEmpty) continue;
                for (int z = z0; z < std::min(z0 + kSuperEdge, nz); ++z) {
                    for (int y = y0; y < std::min(y0 + kSuperEdge, ny); ++y) {
                        for (int x = x0; x < std::min(x0 + kSuperEdge, nx); ++x) {
                            const std::size_t at = (static_cast<std::size_t>(z) * ny + y) * nx + x;
                            states_[at] = whole == BlockState::kFull
                                              ? whole
                                              : decide(lattice, x, y, z, 1, &inside_[at]);
                        }
                    }
                }
            }
        });
    }

    void list_bricks(VoxelVolume& out) {
        const int nx = out.lattice.size[0] / kBrickEdge, ny = out.lattice.size[1] / kBrickEdge;
        mixed_.clear();
        const BlockState* const states = states_.data();
        const int rows = static_cast<int>(states_.size()) / nx;
        for (int row = 0; row < rows; ++row) {
            for (int x = 0; x < nx; ++x) {
                const BlockState state = states[static_cast<std::size_t>(row) * nx + x];
                if (state == BlockState::kEmpty) continue;
                Brick brick;
                brick.x = static_cast<std::int16_t>(x);
                brick.y = static_cast<std::int16_t>(row % ny);
                brick.z = static_cast<std::int16_t>(row / ny);
                std::fill_n(brick.occupancy, kBrickEdge, ~std::uint64_t{0});
                if (state == BlockState::kMixed) {
                    mixed_.push_back({static_cast<int>(out.bricks.size()), row * nx + x});
                }
                out.bricks.push_back(brick);
            }
        }
    }

    void carve_bricks(VoxelVolume& out) {
        const Lattice& lattice = out.lattice;
        const auto first_centre = [&](int axis, int brick) {
            return lattice.origin[axis] + (static_cast<float>(brick * kBrickEdge) + 0.5f) * lattice.voxel_m;
        };
        parallel_for(0, static_cast<int>(mixed_.size()), kBricksPerTask, [&](int first, int last) {
            for (int n = first; n < last; ++n) {
                Brick& brick = out.bricks[mixed_[n].brick];
                carve_brick(maps_.data(), static_cast<int>(maps_.size()), inside_[mixed_[n].place],
                            options_.min_views, first_centre(0, brick.x), first_centre(1, brick.y),
                            first_centre(2, brick.z), lattice.voxel_m, brick.occupancy);
            }
        });
        std::erase_if(out.bricks, [](const Brick& brick) {
            std::uint64_t any = 0;
            for (std::uint64_t slice : brick.occupancy) any |= slice;
            return any == 0;
        });
    }

    HullOptions options_;
    HoleFiller filler_;
    std::vector<const HullView*> present_;
    std::vector<Projector> projectors_;
    std::vector<HullMapsStorage> storage_;
    std::vector<HullMaps> maps_;
    std::vector<BlockState> states_;     // per brick of the lattice, x fastest
    std::vector<std::uint64_t> inside_;  // per brick that is mixed: the views that contain it, a bit each
    struct Mixed {
        int brick, place;  // index into the volume's bricks and into states_
    };
    std::vector<Mixed> mixed_;
};

}  // namespace

void check_lattice(const Lattice& lattice) {
    double voxels = 1;
    for (int axis = 0; axis < 3; ++axis) {
        const int size = lattice.size[axis];
        if (size <= 0 || size % kBrickEdge != 0 || size / kBrickEdge > 32767) {
            throw std::invalid_argument("lattice: size " + std::to_string(size) +
                                        " is not a positive multiple of " + std::to_string(kBrickEdge));
        }
        if (!std::isfinite(lattice.origin[axis]))
            throw std::invalid_argument("lattice: origin is not finite");
        voxels *= size;
    }
    if (voxels > 2147483648.0)
        throw std::invalid_argument("lattice: more than 2^31 voxels; use a larger voxel_m");
    if (!(lattice.voxel_m > 0) || !std::isfinite(lattice.voxel_m)) {
        throw std::invalid_argument("lattice: voxel_m must be positive");
    }
}

std::unique_ptr<HullCarver> make_hull_carver_cpu(const HullOptions& options) {
    return std::make_unique<CpuHullCarver>(options);
}

}  // namespace kinevox::kernels
