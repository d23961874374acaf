// Voxel colouring on the CPU. Each round looks at a snapshot of the surface: every brick writes only its own
// bits, from images that were complete before, so threads and their order never show in the result.
#include "kernels/cpu/colouring.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "kernels/cpu/carving_marks.h"
#include "kernels/cpu/cell_colours.h"
#include "kernels/cpu/colouring_steps.h"
#include "kernels/cpu/hull.h"
#include "kernels/cpu/hull_maps.h"
#include "kernels/cpu/parallel.h"
#include "kernels/cpu/surface.h"
#include "kernels/cpu/surrounded.h"
#include "kernels/cpu/visibility.h"

namespace kinevox::kernels {
namespace {

constexpr int kBricksPerTask = 8;

class CpuVoxelColourer final : public VoxelColourer {
  public:
    explicit CpuVoxelColourer(const ColouringOptions& options) : options_(options) {
        for (std::size_t n = 0; n < limits_.size(); ++n) {
            limits_[n] = colour_limit(static_cast<std::uint8_t>(n), options.max_colour_difference_std,
                                      options.noise_grey);
        }
    }

    void colour(std::span<const ColouringView> views, VoxelVolume& volume, ColouringReport& report) override {
        report = {};
        prepare(views);
        if (options_.max_rounds > 0) {
            report.carved += carve_by_sharp(views, volume);
            drop_empty_bricks(volume);
            report.carved -=
                filler_.fill(volume, options_.fill_radius_m, kFillLinesOfColouring, kFillPassesOfColouring);
        }
        const int view_count = static_cast<int>(views.size());
        parallel_for(0, view_count, 1, [&](int first, int last) {
            for (int n = first; n < last; ++n) frame_view(volume, views_[n]);
        });
        grid_.build(volume);
        look(volume, true);
        parallel_for(0, view_count, 1, [&](int first, int last) {
            for (int n = first; n < last; ++n) {
                make_cell_colours(views[n].image, views_[n],
                                  options_.max_colour_difference_std > 0 ? &limits_ : nullptr, colours_[n]);
            }
        });
        while (report.rounds < options_.max_rounds) {
            const std::int64_t carved = carve_round(volume, report.rounds == 0);
            ++report.rounds;
            report.carved += carved;
            if (carved == 0) break;
            look(volume, false);
        }
        volume.colours.resize(surface_.size());
        parallel_for(0, static_cast<int>(volume.bricks.size()), kBricksPerTask, [&](int first, int last) {
            for (int brick = first; brick < last; ++brick)
                paint_brick(colours_, views_, surface_, brick, volume);
        });
        drop_empty_bricks(volume);  // they have no surface: the colours' order stays
        report.silhouette_iou.assign(views.size(), 0);
        parallel_for(0, static_cast<int>(views.size()), 1, [&](int first, int last) {
            for (int n = first; n < last; ++n) {
                report.silhouette_iou[n] = silhouette_iou(views[n], views_[n]);
            }
        });
    }

  private:
    void prepare(std::span<const ColouringView> views) {
        check_colouring_views(views);
        views_.resize(views.size());
        colours_.resize(views.size());
        for (std::size_t n = 0; n < views.size(); ++n) {
            views_[n].camera = make_projector(*views[n].camera, "colouring: camera");
        }
    }

    // What sticks out of the sharp silhouettes; bricks that are wholly inside cost one look.
    std::int64_t carve_by_sharp(std::span<const ColouringView> views, VoxelVolume& volume) {
        if (options_.sharp_budget_permille < 0) return 0;
        sharp_views_.clear();
        for (std::size_t n = 0; n < views.size(); ++n) {
            if (views[n].sharp) sharp_views_.push_back(static_cast<int>(n));
        }
        const int count = static_cast<int>(sharp_views_.size());
        if (count == 0) return 0;
        if (sharp_maps_.size() < sharp_views_.size()) sharp_maps_.resize(sharp_views_.size());
        std::vector<HullMaps> maps(count);
        const Lattice& lattice = volume.lattice;
        const float half = 0.5f * kBrickEdge * lattice.voxel_m;
        parallel_for(0, count, 1, [&](int first, int last) {
            for (int n = first; n < last; ++n) {
                const ColouringView& view = views[sharp_views_[n]];
                const Projector& camera = views_[sharp_views_[n]].camera;
                const Rect bounds =
                    view.bounds.empty() ? bounds_of(view.sharp, camera.width, camera.height) : view.bounds;
                make_hull_maps({view.camera, view.sharp, bounds}, camera, options_.sharp_budget_permille,
                               typical_block_radius_px(camera, lattice, half), sharp_maps_[n]);
                maps[n] = sharp_maps_[n].maps;
            }
        });
        const int bricks = static_cast<int>(volume.bricks.size());
        carved_.assign(bricks, 0);
        parallel_for(0, bricks, kBricksPerTask, [&](int first, int last) {
            for (int n = first; n < last; ++n) {
                Brick& brick = volume.bricks[n];
                const auto corner = [&](int axis, int at) {
                    return lattice.origin[axis] + static_cast<float>(at * kBrickEdge) * lattice.voxel_m;
                };
                const float x = corner(0, brick.x), y = corner(1, brick.y), z = corner(2, brick.z);
                const float to_centre = 0.5f * lattice.voxel_m;
                std::uint64_t inside = 0;
                const BlockState whole = decide_block(maps.data(), count, 0, x + half, y + half, z + half,
                                                      half - to_centre, &inside);
                if (whole == BlockState::kFull) continue;
                for (std::uint64_t slice : brick.occupancy) carved_[n] += std::popcount(slice);
                if (whole == BlockState::kEmpty) {
                    std::fill_n(brick.occupancy, kBrickEdge, std::uint64_t{0});
                    continue;
                }
                carve_brick(maps.data(), count, inside, 0, x + to_centre, y + to_centre, z + to_centre,
                            lattice.voxel_m, brick.occupancy);
                for (std::uint64_t slice : brick.occupancy) carved_[n] -= std::popcount(slice);
            }
        });
        return sum_carved();
    }

    // The surface and its depth in every view, as they are now.
    void look(const VoxelVolume& volume, bool first_look) {
        surface_.build(volume, grid_);
        // One task a view, so that its images stay in one core's cache.
        parallel_for(0, static_cast<int>(views_.size()), 1, [&](int first, int last) {
            for (int n = first; n < last; ++n)
                look_at_surface(surface_, volume.lattice.voxel_m, first_look, views_[n]);
        });
    }

    // Marks first, from the volume as it was, then clears.
    std::int64_t carve_round(VoxelVolume& volume, bool first_round) {
        const int bricks = static_cast<int>(volume.bricks.size());
        marks_.assign(static_cast<std::size_t>(bricks) * kBrickEdge, 0);
        parallel_for(0, bricks, kBricksPerTask, [&](int first, int last) {
            for (int brick = first; brick < last; ++brick) {
                if (first_round || changed_around(volume, brick)) mark_brick(volume, brick);
            }
        });
        carved_.assign(bricks, 0);
        parallel_for(0, bricks, 256, [&](int first, int last) {
            for (int n = first; n < last; ++n) {
                for (int k = 0; k < kBrickEdge; ++k) {
                    const std::uint64_t mark = marks_[static_cast<std::size_t>(n) * kBrickEdge + k];
                    if (mark == 0) continue;
                    carved_[n] += std::popcount(mark);
                    volume.bricks[n].occupancy[k] &= ~mark;
                }
            }
        });
        return sum_carved();
    }

    // True if the last round took a voxel from the brick or from one of the 26 around it. Elsewhere the
    // answer would be the same again, but for a camera whose sight was cleared from afar.
    bool changed_around(const VoxelVolume& volume, int brick) const {
        const Brick& b = volume.bricks[brick];
        for (int dz = -1; dz <= 1; ++dz) {
            for (int dy = -1; dy <= 1; ++dy) {
                for (int dx = -1; dx <= 1; ++dx) {
                    const int near = grid_.find(b.x + dx, b.y + dy, b.z + dz);
                    if (near >= 0 && carved_[near] > 0) return true;
                }
            }
        }
        return false;
    }

    void mark_brick(const VoxelVolume& volume, int brick) {
        const int first = surface_.first[brick], last = surface_.first[brick + 1];
        if (first == last) return;
        const float voxel = volume.lattice.voxel_m;
        const int radius = std::clamp(
            static_cast<int>(std::lround((options_.support_edge_m / voxel - 1) / 2)), 1, kMaxSupportRadius);
        const int edge = 2 * radius + 1;
        const auto least = static_cast<int>(options_.min_support * static_cast<float>(edge * edge * edge));
        std::uint64_t thin[kBrickEdge] = {};
        if (least > 0) find_unsupported(volume, grid_, brick, radius, least, thin);
        mark_voxels({views_, colours_, options_.min_ray_length_m}, surface_, first, last, thin,
                    marks_.data() + static_cast<std::size_t>(brick) * kBrickEdge);
    }

    std::int64_t sum_carved() const {
        std::int64_t sum = 0;
        for (int count : carved_) sum += count;
        return sum;
    }

    static void drop_empty_bricks(VoxelVolume& volume) {
        std::erase_if(volume.bricks, [](const Brick& brick) {
            std::uint64_t any = 0;
            for (std::uint64_t slice : brick.occupancy) any |= slice;
            return any == 0;
        });
    }

    ColouringOptions options_;
    HoleFiller filler_;
    BrickGrid grid_;
    Surface surface_;
    std::vector<ViewOfVolume> views_;
    std::vector<CellColours> colours_;
    ColourLimits limits_;
    std::vector<int> sharp_views_;
    std::vector<HullMapsStorage> sharp_maps_;
    std::vector<int> carved_;           // per brick, in the step at hand
    std::vector<std::uint64_t> marks_;  // as occupancy, of the voxels to go
};

}  // namespace

void check_colouring_views(std::span<const ColouringView> views) {
    if (views.size() > kMaxViews) {
        throw std::invalid_argument("colouring: " + std::to_string(views.size()) + " views; at most " +
                                    std::to_string(kMaxViews));
    }
    for (std::size_t n = 0; n < views.size(); ++n) {
        const ColouringView& view = views[n];
        if (!view.camera)
            throw std::invalid_argument("colouring: view " + std::to_string(n) + " has no camera");
        const ImageView& image = view.image;
        if (!image.data) continue;
        if (image.width != view.camera->width || image.height != view.camera->height ||
            (image.channels != 1 && image.channels != 3)) {
            throw std::invalid_argument("colouring: image " + std::to_string(n) + " is " +
                                        std::to_string(image.width) + " x " + std::to_string(image.height) +
                                        " with " + std::to_string(image.channels) +
                                        " channels, not its camera's size with 1 or 3");
        }
    }
}

std::unique_ptr<VoxelColourer> make_voxel_colourer_cpu(const ColouringOptions& options) {
    return std::make_unique<CpuVoxelColourer>(options);
}

}  // namespace kinevox::kernels
