#include "server/pose/body_colours.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <optional>

#include "server/pose/turned_posture.h"

namespace kinevox {
namespace {

constexpr double kPriorCells = 200;      // with the colours of the whole subject, in each part's histogram
constexpr double kCellWeight = 0.3;      // neighbours are correlated; measured with tests/accuracy/sweep.py
constexpr float kCore = 0.8f;            // of a capsule's radius: its border may show what is behind
constexpr double kExampleMemory = 0.98;  // of add(): weight of the examples before after each
constexpr std::size_t kMaxSamples = 200'000;  // per camera, for the borders of the bins

// The part of a segment: itself, of the left limbs the right one.
constexpr std::array<std::uint8_t, kBodySegmentCount> make_parts() {
    std::array<std::uint8_t, kBodySegmentCount> parts{};
    for (int s = 0; s < kBodySegmentCount; ++s) parts[s] = static_cast<std::uint8_t>(s);
    for (const LimbSegmentPairs& pairs : {kLegSegments, kArmSegments})
        for (const auto& [left, right] : pairs) parts[left] = static_cast<std::uint8_t>(right);
    return parts;
}
constexpr std::array<std::uint8_t, kBodySegmentCount> kPartOfSegment = make_parts();

// Luminance and two colour differences.
std::array<float, 3> channels_of(const std::array<std::uint8_t, 3>& bgr) {
    const float b = bgr[0], g = bgr[1], r = bgr[2];
    const float y = 0.114f * b + 0.587f * g + 0.299f * r;
    return {y, b - y, r - y};
}

// A capsule in the cells of a view.
struct CapsuleInCells {
    float ax, ay, bx, by, radius_a, radius_b;  // cells
    float depth_a, depth_b;                    // m
};
std::optional<CapsuleInCells> in_cells(const SilhouetteRays& view, const BodyCapsule& capsule) {
    const Camera& camera = *view.camera;
    const ViewColours& grid = view.colours;
    const Vec3 a{capsule.a[0], capsule.a[1], capsule.a[2]}, b{capsule.b[0], capsule.b[1], capsule.b[2]};
    const auto depth_a = static_cast<float>((camera.camera_from_world * a).z),
               depth_b = static_cast<float>((camera.camera_from_world * b).z);
    constexpr float kMinDepth_m = 0.2f;
    if (!(depth_a > kMinDepth_m) || !(depth_b > kMinDepth_m)) return std::nullopt;
    const std::optional<Vec2> pixel_a = camera.project(a), pixel_b = camera.project(b);
    if (!pixel_a || !pixel_b) return std::nullopt;
    const auto cell = [&](double pixel, int origin) {
        return static_cast<float>((pixel - origin + 0.5) / grid.cell - 0.5);
    };
    const float focal = static_cast<float>(0.5 * (camera.fx + camera.fy) / grid.cell);
    return CapsuleInCells{cell(pixel_a->x, grid.x0),
                          cell(pixel_a->y, grid.y0),
                          cell(pixel_b->x, grid.x0),
                          cell(pixel_b->y, grid.y0),
                          capsule.radius_a * focal / depth_a,
                          capsule.radius_b * focal / depth_b,
                          depth_a,
                          depth_b};
}

// Calls f(cell, square, surface_m) for each cell of a capsule that may_count(cell): the squared distance from
// its axis in radii, and the depth of its surface there.
template <typename G, typename F>
void each_cell(const ViewColours& grid, const BodyCapsule& capsule, const CapsuleInCells& in,
               const G& may_count, const F& f) {
    const auto begin = [](float a, float b) {
        return std::max(0, static_cast<int>(std::ceil(std::min(a, b))));
    };
    const auto end = [](float a, float b, int count) {
        return std::min(count, static_cast<int>(std::floor(std::max(a, b))) + 1);
    };
    const int x0 = begin(in.ax - in.radius_a, in.bx - in.radius_b),
              x1 = end(in.ax + in.radius_a, in.bx + in.radius_b, grid.columns),
              y0 = begin(in.ay - in.radius_a, in.by - in.radius_b),
              y1 = end(in.ay + in.radius_a, in.by + in.radius_b, grid.rows);
    const float dx = in.bx - in.ax, dy = in.by - in.ay;
    const float per_length2 = 1 / std::max(1e-6f, dx * dx + dy * dy);
    for (int y = y0; y < y1; ++y)
        for (int x = x0; x < x1; ++x) {
            const std::size_t cell = static_cast<std::size_t>(y) * grid.columns + x;
            if (!may_count(cell)) continue;
            const float px = static_cast<float>(x) - in.ax, py = static_cast<float>(y) - in.ay;
            const float along = std::clamp((px * dx + py * dy) * per_length2, 0.f, 1.f);
            const float qx = px - along * dx, qy = py - along * dy;
            const float radius = in.radius_a + along * (in.radius_b - in.radius_a);
            const float from_axis2 = qx * qx + qy * qy, radius2 = radius * radius;
            if (!(from_axis2 < radius2)) continue;
            const float square = from_axis2 / radius2;
            const float radius_m = capsule.radius_a + along * (capsule.radius_b - capsule.radius_a);
            f(cell, square,
              in.depth_a + along * (in.depth_b - in.depth_a) - radius_m * std::sqrt(1 - square));
        }
}

// The parts that a posture shows in the cells of a view. Keeps its memory.
class PartImage {
  public:
    void draw(const SilhouetteRays& view, std::span<const BodyCapsule> capsules) {
        const std::size_t cells = view.colours.inside.size();
        depth_m_.assign(cells, std::numeric_limits<float>::infinity());
        part_.assign(cells, 0), covering_.assign(cells, 0), core_.assign(cells, 0);
        for (const BodyCapsule& capsule : capsules)
            if (const auto in = in_cells(view, capsule)) draw(view.colours, capsule, *in);
    }
    bool covered(std::size_t cell) const { return covering_[cell] != 0; }
    int part(std::size_t cell) const { return part_[cell]; }  // the nearest
    float depth_m(std::size_t cell) const { return depth_m_[cell]; }
    // Whether the cell's ray meets the core of one part, and no other part.
    bool certain(std::size_t cell) const {
        const unsigned part = 1u << part_[cell];
        return covering_[cell] == part && core_[cell] == part;
    }

  private:
    void draw(const ViewColours& grid, const BodyCapsule& capsule, const CapsuleInCells& in) {
        const std::uint8_t own = kPartOfSegment[capsule.segment];
        const auto bit = static_cast<std::uint16_t>(1u << own);
        each_cell(
            grid, capsule, in, [](std::size_t) { return true; },
            [&](std::size_t cell, float square, float surface_m) {
                covering_[cell] |= bit;
                if (square < kCore * kCore) core_[cell] |= bit;
                if (surface_m < depth_m_[cell]) depth_m_[cell] = surface_m, part_[cell] = own;
            });
    }

    std::vector<float> depth_m_;  // of the nearest surface
    std::vector<std::uint8_t> part_;
    std::vector<std::uint16_t> covering_, core_;  // a bit per part
    static_assert(kBodySegmentCount <= 16);
};

}  // namespace

int BodyColours::Histograms::bin(const std::array<std::uint8_t, 3>& colour) const {
    const std::array<float, 3> channels = channels_of(colour);
    int bin = 0;
    for (int k = 0; k < 3; ++k) {
        int n = 0;
        while (n < kBins - 1 && channels[k] > borders[k][n]) ++n;
        bin = bin * kBins + n;
    }
    return bin;
}

// So that each bin of a channel holds as many cells.
void BodyColours::Histograms::set_borders(std::span<const Seen> views) {
    std::size_t cells = 0;
    for (const Seen& seen : views) cells += seen.view->colours.inside.size();
    const std::size_t stride = cells / kMaxSamples + 1;
    std::array<std::vector<float>, 3> samples;
    for (const Seen& seen : views) {
        const ViewColours& grid = seen.view->colours;
        for (std::size_t cell = 0; cell < grid.inside.size(); cell += stride)
            if (grid.inside[cell]) {
                const std::array<float, 3> channels = channels_of(grid.colour[cell]);
                for (int k = 0; k < 3; ++k) samples[k].push_back(channels[k]);
            }
    }
    if (samples[0].empty()) return;
    for (int k = 0; k < 3; ++k)
        for (int n = 0; n + 1 < kBins; ++n) {
            const auto nth =
                samples[k].begin() + static_cast<std::ptrdiff_t>((n + 1) * samples[k].size() / kBins);
            std::nth_element(samples[k].begin(), nth, samples[k].end());
            borders[k][n] = *nth;
        }
}

// The examples so far keep `memory` of their weight.
void BodyColours::Histograms::count(std::span<const Seen> views, double memory) {
    whole.resize(kColours, 0), parts.resize(kBodySegmentCount * kColours, 0);
    for (float& cells : whole) cells *= static_cast<float>(memory);
    for (float& cells : parts) cells *= static_cast<float>(memory);
    PartImage shown;
    for (const Seen& seen : views) {
        const ViewColours& grid = seen.view->colours;
        shown.draw(*seen.view, seen.capsules);
        for (std::size_t cell = 0; cell < grid.inside.size(); ++cell) {
            if (!grid.inside[cell]) continue;
            const int colour = bin(grid.colour[cell]);
            ++whole[colour];
            if (shown.certain(cell)) ++parts[shown.part(cell) * kColours + colour];
        }
    }
    const double sum = 1 + std::accumulate(whole.begin(), whole.end(), 0.0);
    for (int p = 0; p < kBodySegmentCount; ++p) {
        const auto part = std::span(parts).subspan(p * kColours, kColours);
        const double cells = std::accumulate(part.begin(), part.end(), 0.0);
        for (int colour = 0; colour < kColours; ++colour) {
            const double expected = (whole[colour] + 1.0 / kColours) / sum;
            const double own = (part[colour] + kPriorCells * expected) / (cells + kPriorCells);
            cost[p][colour] = static_cast<float>(-kCellWeight * std::log(own / expected));
        }
    }
}

void BodyColours::learn(std::span<const Example> examples) {
    std::size_t cameras = 0;
    for (const Example& example : examples) cameras = std::max(cameras, example.views.size());
    cameras_.assign(cameras, {});
    for (std::size_t c = 0; c < cameras; ++c) {
        std::vector<Seen> views;
        for (const Example& example : examples)
            if (c < example.views.size() && example.views[c].camera && !example.views[c].colours.empty())
                views.push_back({&example.views[c], example.capsules});
        cameras_[c].set_borders(views);
        cameras_[c].count(views, 0);
    }
}

void BodyColours::add(std::span<const SilhouetteRays> views, std::span<const BodyCapsule> capsules) {
    cameras_.resize(std::max(cameras_.size(), views.size()));
    for (std::size_t c = 0; c < views.size(); ++c) {
        if (!views[c].camera || views[c].colours.empty() || views[c].distance.has_shared()) continue;
        const Seen seen{&views[c], capsules};
        if (cameras_[c].whole.empty()) cameras_[c].set_borders({&seen, 1});
        cameras_[c].count({&seen, 1}, kExampleMemory);
    }
}

double BodyColours::cost(std::span<const SilhouetteRays> views, std::span<const BodyCapsule> capsules) const {
    thread_local PartImage shown;
    double sum = 0;
    for (std::size_t c = 0; c < views.size() && c < cameras_.size(); ++c) {
        const ViewColours& grid = views[c].colours;
        if (!views[c].camera || grid.empty() || cameras_[c].whole.empty()) continue;
        shown.draw(views[c], capsules);
        for (std::size_t cell = 0; cell < grid.inside.size(); ++cell)
            if (grid.inside[cell] && shown.covered(cell))
                sum += cameras_[c].cost[shown.part(cell)][cameras_[c].bin(grid.colour[cell])];
    }
    return sum;
}

double BodyColours::cost(std::span<const SilhouetteRays> views, const BodyModel& model,
                         const BodyPosture& posture) const {
    std::vector<BodyCapsule> capsules;
    model.capsules(model.forward(posture), capsules);
    return cost(views, capsules);
}

PartialColourCost::PartialColourCost(const BodyColours& colours, std::span<const SilhouetteRays> views,
                                     std::span<const BodyCapsule> fixed) {
    PartImage shown;
    for (std::size_t c = 0; c < views.size() && c < colours.cameras_.size(); ++c) {
        const SilhouetteRays& view = views[c];
        const BodyColours::Histograms& learned = colours.cameras_[c];
        if (!view.camera || view.colours.empty() || learned.whole.empty()) continue;
        shown.draw(view, fixed);
        View& own = views_.emplace_back(View{&view, &learned, {}});
        own.cells.resize(view.colours.inside.size());
        for (std::size_t cell = 0; cell < own.cells.size(); ++cell) {
            Cell& at = own.cells[cell];
            at.depth_m = at.fixed_depth_m = shown.depth_m(cell);
            at.part = shown.covered(cell) ? static_cast<std::int8_t>(shown.part(cell)) : kNoPart;
        }
    }
}

double PartialColourCost::cost(std::span<const BodyCapsule> moving) {
    double sum = 0;
    for (View& view : views_) {
        changed_.clear();
        for (const BodyCapsule& capsule : moving) {
            const auto in = in_cells(*view.rays, capsule);
            if (!in) continue;
            const auto& cost = view.learned->cost[kPartOfSegment[capsule.segment]];
            const float nearest_m =
                std::min(in->depth_a, in->depth_b) - std::max(capsule.radius_a, capsule.radius_b);
            const auto may_show = [&](std::size_t n) {
                return view.rays->colours.inside[n] && nearest_m < view.cells[n].depth_m;
            };
            each_cell(view.rays->colours, capsule, *in, may_show, [&](std::size_t n, float, float surface_m) {
                Cell& cell = view.cells[n];
                if (surface_m >= cell.depth_m) return;
                if (cell.colour < 0) {
                    cell.colour = static_cast<std::int16_t>(view.learned->bin(view.rays->colours.colour[n]));
                    if (cell.part != kNoPart) cell.cost = view.learned->cost[cell.part][cell.colour];
                    cell.fixed_cost = cell.cost;
                }
                if (cell.depth_m == cell.fixed_depth_m) changed_.push_back(n);
                sum += cost[cell.colour] - cell.cost;
                cell.depth_m = surface_m, cell.cost = cost[cell.colour];
            });
        }
        for (const std::size_t n : changed_) {
            Cell& cell = view.cells[n];
            cell.depth_m = cell.fixed_depth_m, cell.cost = cell.fixed_cost;
        }
    }
    return sum;
}

}  // namespace kinevox
