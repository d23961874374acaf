#include "server/pipeline/tracking/occupied_cells.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <utility>

namespace kinevox {
namespace {

constexpr int kEdge = kernels::kBrickEdge;

constexpr std::size_t kSampledCells = 1000;  // for the fraction that a camera shows

// Trunks of people who stand, kneel or bend slightly.
constexpr double kTrunkFrom_m = 0.8, kTrunkTo_m = 1.5;
constexpr double kTrunkRadius_m = 0.14;
constexpr double kMinTrunkDistance_m = 0.4;
constexpr double kMinTrunkRatio = 0.55;   // of the cells around one trunk and around the largest
constexpr double kMaxValleyRatio = 0.75;  // of the cells between two trunks and around the smaller

constexpr double kMaxTrunkBottom_m = 0.9;

// Halves of a person: a gap as high as a stripe of a shirt, or arms that hang beside the lower one.
constexpr double kMinHalf_litres = 8;
constexpr double kMaxHalvesGap_m = 0.25, kMaxHalvesOverlap_m = 0.4;  // vertical
constexpr double kMaxHalvesApart_m = 0.4;                            // of their centres, horizontal

constexpr double kMaxLimb_litres = 15;  // in the hull
constexpr double kMinLimbGap_m = 0.15;  // a smaller one may be a gap in the silhouettes of one limb

}  // namespace

OccupiedCells::OccupiedCells(const kernels::Lattice& lattice)
    : lattice_(lattice),
      label_(static_cast<std::size_t>(lattice.size[0]) * lattice.size[1] * lattice.size[2], kEmpty),
      visited_(label_.size(), 0) {}

kernels::Lattice OccupiedCells::part_over(const Box3& box) const {
    const double low[3] = {box.min_in_world.x, box.min_in_world.y, box.min_in_world.z};
    const double high[3] = {box.max_in_world.x, box.max_in_world.y, box.max_in_world.z};
    const double brick_m = kEdge * cell_m();
    kernels::Lattice part = lattice_;
    for (int axis = 0; axis < 3; ++axis) {
        const double origin = static_cast<double>(lattice_.origin[axis]);
        const int bricks = lattice_.size[axis] / kEdge;
        const int first = std::clamp(static_cast<int>(std::floor((low[axis] - origin) / brick_m)), 0, bricks);
        const int last =
            std::clamp(static_cast<int>(std::ceil((high[axis] - origin) / brick_m)), first, bricks);
        part.origin[axis] = lattice_.origin[axis] + static_cast<float>(kEdge * first) * lattice_.voxel_m;
        part.size[axis] = kEdge * (last - first);
    }
    return part;
}

void OccupiedCells::clear() {
    for (const std::int32_t cell : occupied_) label_[cell] = kEmpty;
    occupied_.clear();
}

void OccupiedCells::add(const kernels::VoxelVolume& volume) {
    int first[3];  // cell of the volume in this lattice
    for (int axis = 0; axis < 3; ++axis)
        first[axis] = static_cast<int>(
            std::lround((volume.lattice.origin[axis] - lattice_.origin[axis]) / lattice_.voxel_m));
    for (const kernels::Brick& brick : volume.bricks)
        for (int z = 0; z < kEdge; ++z)
            for (std::uint64_t left = brick.occupancy[z]; left != 0; left &= left - 1) {
                const int bit = std::countr_zero(left);
                const int x = first[0] + kEdge * brick.x + bit % kEdge,
                          y = first[1] + kEdge * brick.y + bit / kEdge,
                          layer = first[2] + kEdge * brick.z + z;
                const std::int32_t cell = (layer * lattice_.size[1] + y) * lattice_.size[0] + x;
                if (label_[cell] != kEmpty) continue;
                label_[cell] = kFree;
                occupied_.push_back(cell);
            }
    std::sort(occupied_.begin(), occupied_.end());
}

std::array<int, 3> OccupiedCells::position(std::int32_t cell) const {
    const int row = cell / lattice_.size[0];
    return {cell % lattice_.size[0], row % lattice_.size[1], row / lattice_.size[1]};
}

Vec3 OccupiedCells::centre_in_world(std::int32_t cell) const {
    const auto [x, y, z] = position(cell);
    const auto along = [&](int axis, int n) {
        return static_cast<double>(lattice_.origin[axis]) + cell_m() * (n + 0.5);
    };
    return {along(0, x), along(1, y), along(2, z)};
}

// The cells around one, in the order of their indices.
template <class F>
void OccupiedCells::for_each_neighbour(std::int32_t cell, F visit) const {
    const auto at = position(cell);
    const int nx = lattice_.size[0], ny = lattice_.size[1];
    const bool inner = std::ranges::all_of(
        std::array{0, 1, 2}, [&](int axis) { return at[axis] > 0 && at[axis] + 1 < lattice_.size[axis]; });
    for (int c = -1; c <= 1; ++c)
        for (int b = -1; b <= 1; ++b)
            for (int a = -1; a <= 1; ++a)
                if (inner || (at[0] + a >= 0 && at[0] + a < nx && at[1] + b >= 0 && at[1] + b < ny &&
                              at[2] + c >= 0 && at[2] + c < lattice_.size[2]))
                    visit(cell + (c * ny + b) * nx + a);
}

int OccupiedCells::index_along(int axis, double in_world_m) const {
    const double cells = std::floor((in_world_m - static_cast<double>(lattice_.origin[axis])) / cell_m());
    return cells >= 0 && cells < lattice_.size[axis] ? static_cast<int>(cells) : -1;
}

std::uint8_t OccupiedCells::label_at(Vec3 p) const {
    const int x = index_along(0, p.x), y = index_along(1, p.y), z = index_along(2, p.z);
    if (x < 0 || y < 0 || z < 0) return kEmpty;
    return label_[(static_cast<std::size_t>(z) * lattice_.size[1] + y) * lattice_.size[0] + x];
}

std::array<std::vector<int>, 3> OccupiedCells::cells_along(const kernels::Lattice& other) const {
    std::array<std::vector<int>, 3> cells;
    for (int axis = 0; axis < 3; ++axis)
        for (int n = 0; n < other.size[axis]; ++n)
            cells[axis].push_back(index_along(axis, static_cast<double>(other.origin[axis]) +
                                                        static_cast<double>(other.voxel_m) * (n + 0.5)));
    return cells;
}

void OccupiedCells::keep(std::uint8_t label, kernels::VoxelVolume& volume) const {
    const std::array<std::vector<int>, 3> cell = cells_along(volume.lattice);
    for (kernels::Brick& brick : volume.bricks) {
        const int *const xs = cell[0].data() + kEdge * brick.x, *const ys = cell[1].data() + kEdge * brick.y;
        for (int z = 0; z < kEdge; ++z) {
            const int layer = cell[2][kEdge * brick.z + z];
            std::uint64_t kept = 0;
            for (std::uint64_t left = layer < 0 ? 0 : brick.occupancy[z]; left != 0; left &= left - 1) {
                const int bit = std::countr_zero(left), x = xs[bit % kEdge], y = ys[bit / kEdge];
                if (x < 0 || y < 0) continue;
                const std::size_t at =
                    (static_cast<std::size_t>(layer) * lattice_.size[1] + y) * lattice_.size[0] + x;
                if (label_[at] == label) kept |= std::uint64_t{1} << bit;
            }
            brick.occupancy[z] = kept;
        }
    }
    std::erase_if(volume.bricks, [](const kernels::Brick& brick) {
        return std::ranges::all_of(brick.occupancy, [](std::uint64_t layer) { return layer == 0; });
    });
}

void OccupiedCells::give(const Cells& cells, const std::array<int, 3>& shift, std::uint8_t label) {
    for (const std::int32_t cell : cells) {
        const auto [x, y, z] = position(cell);
        const int moved[3] = {x + shift[0], y + shift[1], z + shift[2]};
        if (moved[0] < 0 || moved[1] < 0 || moved[2] < 0 || moved[0] >= lattice_.size[0] ||
            moved[1] >= lattice_.size[1] || moved[2] >= lattice_.size[2])
            continue;
        std::uint8_t& at = label_[(moved[2] * lattice_.size[1] + moved[1]) * lattice_.size[0] + moved[0]];
        if (at == kFree)
            at = label;
        else if (at != kEmpty && at != label)
            at = kContested;
    }
}

void OccupiedCells::flood(int max_steps) {
    Cells front, next;
    for (const std::int32_t cell : occupied_) {
        if (label_[cell] == kContested) label_[cell] = kFree;
        if (label_[cell] != kFree) front.push_back(cell);
    }
    const int step[3] = {1, lattice_.size[0], lattice_.size[0] * lattice_.size[1]};
    for (int n = 0; n < max_steps && !front.empty(); ++n) {
        next.clear();
        for (const std::int32_t cell : front) {
            const auto at = position(cell);
            for (int axis = 0; axis < 3; ++axis)
                for (const int side : {-1, 1}) {
                    const int moved = at[axis] + side;
                    if (moved < 0 || moved >= lattice_.size[axis]) continue;
                    std::uint8_t& label = label_[cell + side * step[axis]];
                    if (label != kFree) continue;
                    label = label_[cell];
                    next.push_back(cell + side * step[axis]);
                }
        }
        std::swap(front, next);
    }
}

void OccupiedCells::free(const Cells& cells) {
    for (const std::int32_t cell : cells) label_[cell] = kFree;
}

std::vector<Cells> OccupiedCells::parts(std::uint8_t label) const {
    std::vector<Cells> found;
    for (const std::int32_t cell : occupied_) visited_[cell] = 0;
    for (const std::int32_t first : occupied_) {
        if (label_[first] != label || visited_[first]) continue;
        Cells part{first};
        visited_[first] = 1;
        for (std::size_t k = 0; k < part.size(); ++k)
            for_each_neighbour(part[k], [&](std::int32_t cell) {
                if (label_[cell] != label || visited_[cell]) return;
                visited_[cell] = 1;
                part.push_back(cell);
            });
        found.push_back(std::move(part));
    }
    std::ranges::stable_sort(found, [](const Cells& a, const Cells& b) { return a.size() > b.size(); });
    return found;
}

std::optional<OccupiedCells::Contact> OccupiedCells::largest_contact(const Cells& part) const {
    const std::uint8_t own = label_[part.front()];
    std::array<std::int32_t, kContested> count{}, cell_of{};
    for (const std::int32_t each : part)
        for_each_neighbour(each, [&](std::int32_t cell) {
            const std::uint8_t label = label_[cell];
            if (label == kEmpty || label >= kContested || label == own) return;
            ++count[label];
            cell_of[label] = cell;
        });
    const auto largest = std::ranges::max_element(count);
    if (*largest == 0) return std::nullopt;
    const auto label = static_cast<std::uint8_t>(largest - count.begin());
    return Contact{label, cell_of[label]};
}

Cells OccupiedCells::cells_of(const kernels::VoxelVolume& volume) const {
    Cells cells;
    const std::array<std::vector<int>, 3> cell = cells_along(volume.lattice);
    for (const kernels::Brick& brick : volume.bricks)
        for (int layer = 0; layer < kEdge; ++layer)
            for (std::uint64_t left = brick.occupancy[layer]; left != 0; left &= left - 1) {
                const int bit = std::countr_zero(left);
                const int x = cell[0][kEdge * brick.x + bit % kEdge],
                          y = cell[1][kEdge * brick.y + bit / kEdge], z = cell[2][kEdge * brick.z + layer];
                if (x >= 0 && y >= 0 && z >= 0)
                    cells.push_back((z * lattice_.size[1] + y) * lattice_.size[0] + x);
            }
    std::ranges::sort(cells);
    cells.erase(std::unique(cells.begin(), cells.end()), cells.end());
    return cells;
}

CellStatistics OccupiedCells::statistics(const Cells& cells) const {
    CellStatistics out;
    if (cells.empty()) return out;
    constexpr double kFar = std::numeric_limits<double>::infinity();
    Vec3 sum, low{kFar, kFar, kFar}, high{-kFar, -kFar, -kFar};
    for (const std::int32_t cell : cells) {
        const Vec3 p = centre_in_world(cell);
        sum += p;
        low = {std::min(low.x, p.x), std::min(low.y, p.y), std::min(low.z, p.z)};
        high = {std::max(high.x, p.x), std::max(high.y, p.y), std::max(high.z, p.z)};
    }
    const Vec3 half{cell_m() / 2, cell_m() / 2, cell_m() / 2};
    out.centre_in_world = sum / static_cast<double>(cells.size());
    out.min_in_world = low - half;
    out.max_in_world = high + half;
    out.litres = 1000 * std::pow(cell_m(), 3) * static_cast<double>(cells.size());
    return out;
}

double OccupiedCells::fraction_in_view(const Cells& cells, const Camera& camera) const {
    const std::size_t step = std::max<std::size_t>(1, cells.size() / kSampledCells);
    std::size_t sampled = 0, inside = 0;
    for (std::size_t n = 0; n < cells.size(); n += step, ++sampled)
        inside += shows(camera, centre_in_world(cells[n]));
    return sampled == 0 ? 0 : static_cast<double>(inside) / static_cast<double>(sampled);
}

kernels::VoxelVolume OccupiedCells::volume_of(const Cells& cells) const {
    std::map<std::array<int, 3>, kernels::Brick> bricks;  // by z, y, x
    for (const std::int32_t cell : cells) {
        const auto [x, y, z] = position(cell);
        kernels::Brick& brick = bricks[{z / kEdge, y / kEdge, x / kEdge}];
        brick.x = static_cast<std::int16_t>(x / kEdge);
        brick.y = static_cast<std::int16_t>(y / kEdge);
        brick.z = static_cast<std::int16_t>(z / kEdge);
        brick.occupancy[z % kEdge] |= std::uint64_t{1} << (y % kEdge * kEdge + x % kEdge);
    }
    kernels::VoxelVolume out;
    out.lattice = lattice_;
    for (const auto& [at, brick] : bricks) out.bricks.push_back(brick);
    return out;
}

namespace {

// Cells of a part's trunk layer per column, summed over the columns around each.
class TrunkMap {
  public:
    TrunkMap(const OccupiedCells& grid, const Cells& part)
        : width_(grid.lattice().size[0]),
          height_(grid.lattice().size[1]),
          radius_(std::max(1, static_cast<int>(std::lround(kTrunkRadius_m / grid.cell_m())))),
          count_(static_cast<std::size_t>(width_) * height_, 0) {
        std::vector<int> columns(count_.size(), 0);
        for (const std::int32_t cell : part) {
            const double z = grid.centre_in_world(cell).z;
            if (z >= kTrunkFrom_m && z <= kTrunkTo_m) ++columns[cell % static_cast<int>(count_.size())];
        }
        for (std::size_t k = 0; k < columns.size(); ++k) {
            if (columns[k] == 0) continue;
            const int x = static_cast<int>(k) % width_, y = static_cast<int>(k) / width_;
            for (int j = std::max(0, y - radius_); j <= std::min(height_ - 1, y + radius_); ++j)
                for (int i = std::max(0, x - radius_); i <= std::min(width_ - 1, x + radius_); ++i)
                    count_[static_cast<std::size_t>(j) * width_ + i] += columns[k];
        }
    }

    struct Peak {
        int x = 0, y = 0, count = 0;
    };
    // The largest local maximum farther than `apart` columns from all of `others`.
    Peak peak(const std::vector<Peak>& others, double apart) const {
        Peak best;
        for (int y = 0; y < height_; ++y)
            for (int x = 0; x < width_; ++x) {
                const int count = count_[static_cast<std::size_t>(y) * width_ + x];
                if (count <= best.count) continue;
                const bool far = std::ranges::all_of(
                    others, [&](const Peak& p) { return std::hypot(x - p.x, y - p.y) >= apart; });
                if (far && is_local_maximum(x, y)) best = {x, y, count};
            }
        return best;
    }
    // The smallest count on the line between two peaks.
    int valley(const Peak& a, const Peak& b) const {
        int lowest = std::min(a.count, b.count);
        const int steps = std::max({1, std::abs(a.x - b.x), std::abs(a.y - b.y)});
        for (int n = 0; n <= steps; ++n) {
            const int x = a.x + (b.x - a.x) * n / steps, y = a.y + (b.y - a.y) * n / steps;
            lowest = std::min(lowest, count_[static_cast<std::size_t>(y) * width_ + x]);
        }
        return lowest;
    }
    int radius() const { return radius_; }

  private:
    bool is_local_maximum(int x, int y) const {
        const int count = count_[static_cast<std::size_t>(y) * width_ + x];
        for (int j = std::max(0, y - 2); j <= std::min(height_ - 1, y + 2); ++j)
            for (int i = std::max(0, x - 2); i <= std::min(width_ - 1, x + 2); ++i)
                if (count_[static_cast<std::size_t>(j) * width_ + i] > count) return false;
        return true;
    }

    int width_, height_, radius_;
    std::vector<int> count_;
};

}  // namespace

bool lacks_legs(const CellStatistics& s) {
    return s.litres >= kMinTrunk_litres && s.max_in_world.z >= kTallPerson_m &&
           s.min_in_world.z > kMaxUprightBottom_m && s.min_in_world.z <= kMaxTrunkBottom_m;
}

void join_halves(const OccupiedCells& grid, std::vector<Cells>& parts) {
    if (parts.size() < 2) return;
    std::vector<CellStatistics> bodies;
    for (const Cells& part : parts) bodies.push_back(grid.statistics(part));
    const auto stands = [&](std::size_t k) { return bodies[k].min_in_world.z <= kMaxUprightBottom_m; };
    for (std::size_t upper = 0; upper < parts.size(); ++upper) {
        if (stands(upper) || bodies[upper].litres < kMinHalf_litres) continue;
        std::optional<std::size_t> below;
        double distance = kMaxHalvesApart_m;
        for (std::size_t k = 0; k < parts.size(); ++k) {
            if (!stands(k) || parts[k].empty() || bodies[k].litres < kMinHalf_litres) continue;
            const double gap = bodies[upper].min_in_world.z - bodies[k].max_in_world.z;
            const Vec3 offset = bodies[upper].centre_in_world - bodies[k].centre_in_world;
            if (gap > kMaxHalvesGap_m || gap < -kMaxHalvesOverlap_m ||
                std::hypot(offset.x, offset.y) > distance)
                continue;
            below = k, distance = std::hypot(offset.x, offset.y);
        }
        if (!below) continue;
        parts[*below].insert(parts[*below].end(), parts[upper].begin(), parts[upper].end());
        bodies[*below] = grid.statistics(parts[*below]);
        parts[upper].clear();
    }
    std::erase_if(parts, [](const Cells& part) { return part.empty(); });
}

namespace {

bool are_near(const OccupiedCells& grid, const Cells& a, const Cells& b, double distance_m) {
    return std::ranges::any_of(a, [&](std::int32_t i) {
        const Vec3 p = grid.centre_in_world(i);
        return std::ranges::any_of(
            b, [&](std::int32_t j) { return norm(p - grid.centre_in_world(j)) < distance_m; });
    });
}

Cells* part_with(std::int32_t cell, std::vector<std::vector<Cells>>& parts) {
    for (std::vector<Cells>& own : parts)
        for (Cells& part : own)
            if (std::ranges::find(part, cell) != part.end()) return &part;
    return nullptr;
}

}  // namespace

void return_limbs(OccupiedCells& grid, std::vector<std::vector<Cells>>& parts) {
    for (std::vector<Cells>& own : parts) {
        for (std::size_t k = 1; k < own.size(); ++k) {
            if (grid.statistics(own[k]).litres > kMaxLimb_litres) continue;
            const auto contact = grid.largest_contact(own[k]);
            if (!contact || are_near(grid, own[k], own[0], kMinLimbGap_m)) continue;
            Cells* const to = part_with(contact->cell, parts);
            if (!to) continue;
            grid.free(own[k]);
            grid.give(own[k], {0, 0, 0}, contact->label);
            to->insert(to->end(), own[k].begin(), own[k].end());
            own[k].clear();
        }
        std::erase_if(own, [](const Cells& part) { return part.empty(); });
    }
}

std::vector<Cells> split_by_trunks(const OccupiedCells& grid, const Cells& part) {
    const TrunkMap map(grid, part);
    std::vector<TrunkMap::Peak> trunks;
    for (;;) {
        const TrunkMap::Peak next = map.peak(trunks, kMinTrunkDistance_m / grid.cell_m());
        if (next.count == 0) break;
        if (!trunks.empty() && next.count < kMinTrunkRatio * trunks.front().count) break;
        const bool apart = std::ranges::all_of(trunks, [&](const TrunkMap::Peak& p) {
            return map.valley(p, next) <= kMaxValleyRatio * std::min(p.count, next.count);
        });
        if (!apart) break;
        trunks.push_back(next);
    }
    if (trunks.size() < 2) return {part};
    std::vector<Cells> shares(trunks.size());
    for (const std::int32_t cell : part) {
        const auto [x, y, z] = grid.position(cell);
        std::size_t nearest = 0;
        double distance = std::numeric_limits<double>::infinity();
        for (std::size_t k = 0; k < trunks.size(); ++k)
            if (const double d = std::hypot(x - trunks[k].x, y - trunks[k].y); d < distance)
                distance = d, nearest = k;
        shares[nearest].push_back(cell);
    }
    return shares;
}

}  // namespace kinevox
