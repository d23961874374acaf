#include "server/pipeline/tracking/appearance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <vector>

#include "server/pipeline/for_each_camera.h"

namespace kinevox {
namespace {

constexpr float kMinWeight = 20;                     // samples of a band that can be compared
constexpr double kLegsTo = 0.45, kTrunkTo = 0.82;    // of the height
constexpr std::array kBandWeights{0.35, 0.45, 0.2};  // the head is small, and hair and skin are alike
constexpr double kMinComparedWeight = 0.5;
constexpr int kMaxShift = 2;         // half octaves
constexpr double kShiftCost = 0.03;  // of each
constexpr float kBinsPerOctave = 2, kMinLuminance_log2 = 3, kMaxChromaticity = 0.65f;
constexpr std::array kBlur{0.25f, 0.5f,
                           0.25f};  // over half octaves, so that small changes of light cost little
constexpr float kNoise_grey = 8;    // so that dark cloth has no chance chromaticity
constexpr std::size_t kMaxSampledCells = 600;

// Position among `count` bins, clamped.
struct SoftBin {
    SoftBin(float at, int count) {
        at = std::clamp(at, 0.0f, static_cast<float>(count - 1));
        first = std::min(static_cast<int>(at), count - 2);
        second_weight = at - static_cast<float>(first);
    }
    float weight(int n) const { return n == 0 ? 1 - second_weight : second_weight; }
    int first = 0;
    float second_weight = 0;
};

float chromaticity_bin(float value, int count) {
    const float compressed = value / (1 + std::abs(value));
    return (compressed / kMaxChromaticity + 1) / 2 * static_cast<float>(count - 1);
}

// The mean of 3 x 3 pixels inside the sharp silhouette; none on its border.
std::optional<kernels::Colour> colour_at(const AppearanceView& view, Vec2 pixel) {
    const kernels::ImageView& image = view.image;
    if (!(pixel.x >= 1 && pixel.y >= 1 && pixel.x < image.width - 2 && pixel.y < image.height - 2))
        return std::nullopt;
    const auto u = static_cast<int>(std::lround(pixel.x)), v = static_cast<int>(std::lround(pixel.y));
    int sum[3] = {0, 0, 0};
    for (int y = v - 1; y <= v + 1; ++y)
        for (int x = u - 1; x <= u + 1; ++x) {
            if (!view.silhouettes->sharp[static_cast<std::size_t>(y) * image.width + x]) return std::nullopt;
            const std::uint8_t* const bgr = image.row(y) + static_cast<std::ptrdiff_t>(x) * image.channels;
            for (int k = 0; k < 3; ++k) sum[k] += bgr[image.channels == 3 ? k : 0];
        }
    const auto mean = [](int total) { return static_cast<std::uint8_t>((total + 4) / 9); };
    return kernels::Colour{mean(sum[2]), mean(sum[1]), mean(sum[0])};
}

// Whether the line from a cell to a point leaves the body at once and meets nothing.
bool sees(const OccupiedCells& grid, Vec3 from, Vec3 to) {
    const kernels::Lattice& lattice = grid.lattice();
    const double cell = grid.cell_m();
    const Vec3 step = (cell / norm(to - from)) * (to - from);
    Vec3 at = from + 1.5 * step;
    const auto inside = [&](double v, int axis) {
        const auto low = static_cast<double>(lattice.origin[axis]);
        return v >= low && v < low + cell * lattice.size[axis];
    };
    for (auto left = static_cast<int>(norm(to - from) / cell) - 2; left > 0; --left) {
        if (!inside(at.x, 0) || !inside(at.y, 1) || !inside(at.z, 2)) return true;
        if (grid.label_at(at) != OccupiedCells::kEmpty) return false;
        at += step;
    }
    return true;
}

BodyBand band_of(double z, double top_m) {
    return z < kLegsTo * top_m ? kLegsBand : z < kTrunkTo * top_m ? kTrunkBand : kHeadBand;
}

}  // namespace

void ColourHistogram::add(kernels::Colour colour) {
    const auto r = static_cast<float>(colour.r), g = static_cast<float>(colour.g),
               b = static_cast<float>(colour.b);
    const float luminance = (r + g + b) / 3 + kNoise_grey;
    const SoftBin first(chromaticity_bin((r - g) / luminance, kChromaticities), kChromaticities);
    const SoftBin second(chromaticity_bin(((r + g) / 2 - b) / luminance, kChromaticities), kChromaticities);
    const float level = kBinsPerOctave * (std::log2(luminance) - kMinLuminance_log2);
    for (std::size_t k = 0; k < kBlur.size(); ++k) {
        const SoftBin third(level + static_cast<float>(k) - 1, kLuminances);
        for (int n = 0; n < 8; ++n) {
            const int at[3] = {third.first + (n & 1), first.first + (n >> 1 & 1),
                               second.first + (n >> 2 & 1)};
            bins_[(at[0] * kChromaticities + at[1]) * kChromaticities + at[2]] +=
                kBlur[k] * third.weight(n & 1) * first.weight(n >> 1 & 1) * second.weight(n >> 2 & 1);
        }
    }
    weight_ += 1;
}

void ColourHistogram::add(const ColourHistogram& other, float weight) {
    for (std::size_t k = 0; k < bins_.size(); ++k) bins_[k] += weight * other.bins_[k];
    weight_ += weight * other.weight_;
}

void ColourHistogram::scale(float factor) {
    for (float& bin : bins_) bin *= factor;
    weight_ *= factor;
}

double ColourHistogram::similarity(const ColourHistogram& other, int shift) const {
    constexpr int kPlane = kChromaticities * kChromaticities;
    double sum = 0;
    for (int k = std::max(0, -shift) * kPlane; k < (kLuminances - std::max(0, shift)) * kPlane; ++k)
        sum +=
            std::sqrt(static_cast<double>(bins_[k]) * static_cast<double>(other.bins_[k + shift * kPlane]));
    return sum / std::sqrt(static_cast<double>(weight_) * static_cast<double>(other.weight_));
}

double colour_distance(const Appearance& a, const Appearance& b) {
    double nearest = std::numeric_limits<double>::quiet_NaN();
    for (int shift = -kMaxShift; shift <= kMaxShift; ++shift) {
        double sum = 0, weight = 0;
        for (int band = 0; band < kBodyBands; ++band) {
            if (std::min(a.colours[band].weight(), b.colours[band].weight()) < kMinWeight) continue;
            sum += kBandWeights[band] * (1 - a.colours[band].similarity(b.colours[band], shift));
            weight += kBandWeights[band];
        }
        if (weight < kMinComparedWeight) break;
        const double distance = std::sqrt(std::max(0.0, sum / weight)) + kShiftCost * std::abs(shift);
        nearest = std::fmin(nearest, distance);
    }
    return nearest;
}

Appearance appearance_of(const OccupiedCells& grid, const Cells& body,
                         std::span<const AppearanceView> views) {
    Appearance out;
    const CellStatistics shape = grid.statistics(body);
    out.top_m = shape.max_in_world.z;
    out.litres = shape.litres;
    std::vector<Vec3> centres;
    for (const AppearanceView& view : views) centres.push_back(view.camera->centre_in_world());
    const std::size_t stride = std::max<std::size_t>(1, body.size() / kMaxSampledCells);
    std::vector<Vec3> cells;
    for (std::size_t n = 0; n < body.size(); n += stride) cells.push_back(grid.centre_in_world(body[n]));
    std::vector<std::vector<std::optional<kernels::Colour>>> colours(views.size());
    for_each_camera(views.size(), [&](std::size_t c) {
        const AppearanceView& view = views[c];
        if (!view.image.data || !view.silhouettes) return;
        colours[c].resize(cells.size());
        for (std::size_t n = 0; n < cells.size(); ++n) {
            if (!sees(grid, cells[n], centres[c])) continue;
            const std::optional<Vec2> pixel = view.camera->project(cells[n]);
            if (pixel) colours[c][n] = colour_at(view, *pixel);
        }
    });
    // In one order, so that the sums do not depend on the threads.
    for (std::size_t n = 0; n < cells.size(); ++n) {
        ColourHistogram& band = out.colours[band_of(cells[n].z, out.top_m)];
        for (const auto& of_view : colours)
            if (!of_view.empty() && of_view[n]) band.add(*of_view[n]);
    }
    return out;
}

}  // namespace kinevox
