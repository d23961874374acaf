#include "server/calibration/coverage.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace kinevox {
namespace {

constexpr int kCells = 10;                // along each axis
constexpr double kRadiusFraction = 0.15;  // of the box's diagonal

bool sees(const Camera& camera, Vec3 point) {
    const auto pixel = camera.project(point);
    return pixel && pixel->x >= -0.5 && pixel->y >= -0.5 && pixel->x < camera.width - 0.5 &&
           pixel->y < camera.height - 0.5;
}

}  // namespace

int Coverage::cell(Vec2 p) const {
    const int column = std::clamp(static_cast<int>((p.x + 0.5) * kColumns / width_), 0, kColumns - 1);
    const int row = std::clamp(static_cast<int>((p.y + 0.5) * kRows / height_), 0, kRows - 1);
    return row * kColumns + column;
}

void Coverage::add(Vec2 pixel) {
    ++counts_[cell(pixel)];
}

bool Coverage::is_new(const std::vector<Vec2>& pixels) const {
    return std::any_of(pixels.begin(), pixels.end(), [&](Vec2 p) { return counts_[cell(p)] == 0; });
}

double Coverage::fraction() const {
    const auto seen = std::count_if(counts_.begin(), counts_.end(), [](int n) { return n > 0; });
    return static_cast<double>(seen) / (kColumns * kRows);
}

std::string Coverage::emptiest() const {
    static constexpr std::array<const char*, 9> kNames{"the upper left", "the upper edge", "the upper right",
                                                       "the left edge",  "the centre",     "the right edge",
                                                       "the lower left", "the lower edge", "the lower right"};
    std::array<int, 9> empty{}, cells{};
    for (int row = 0; row < kRows; ++row)
        for (int column = 0; column < kColumns; ++column) {
            const int region = 3 * (row * 3 / kRows) + column * 3 / kColumns;
            ++cells[region];
            empty[region] += counts_[row * kColumns + column] == 0;
        }
    int worst = 0;
    for (int r = 1; r < 9; ++r)
        if (empty[r] * cells[worst] > empty[worst] * cells[r]) worst = r;
    return empty[worst] == 0 ? "" : kNames[worst];
}

VolumeCoverage volume_coverage(const std::vector<Camera>& cameras, const std::vector<Vec3>& points,
                               Vec3 lower, Vec3 upper) {
    VolumeCoverage out;
    if (!(upper.x > lower.x && upper.y > lower.y && upper.z > lower.z)) {
        lower = {1e9, 1e9, 1e9}, upper = {-1e9, -1e9, -1e9};
        for (const Vec3 p : points) {
            lower = {std::min(lower.x, p.x), std::min(lower.y, p.y), std::min(lower.z, p.z)};
            upper = {std::max(upper.x, p.x), std::max(upper.y, p.y), std::max(upper.z, p.z)};
        }
    }
    out.lower = lower, out.upper = upper;
    if (points.empty() && !(upper.x > lower.x)) return out;
    const Vec3 size = upper - lower;
    const double radius = kRadiusFraction * norm(size);
    int two = 0, three = 0, near = 0;
    for (int i = 0; i < kCells * kCells * kCells; ++i) {
        const Vec3 p{lower.x + size.x * (i % kCells + 0.5) / kCells,
                     lower.y + size.y * (i / kCells % kCells + 0.5) / kCells,
                     lower.z + size.z * (i / kCells / kCells + 0.5) / kCells};
        const auto count =
            std::count_if(cameras.begin(), cameras.end(), [&](const Camera& c) { return sees(c, p); });
        two += count >= 2, three += count >= 3;
        near += std::any_of(points.begin(), points.end(), [&](Vec3 q) { return norm(p - q) < radius; });
    }
    const double all = kCells * kCells * kCells;
    out.two_view_fraction = two / all, out.three_view_fraction = three / all,
    out.calibrated_fraction = near / all;
    return out;
}

std::optional<VolumeCoverage> working_volume(const std::vector<Camera>& cameras,
                                             const std::vector<Vec3>& points) {
    constexpr double kRadius_m = 2.0;  // of a person's hands
    if (points.size() < 3) return std::nullopt;
    Vec3 lower{1e9, 1e9, 0}, upper{-1e9, -1e9, kRadius_m};
    for (const Vec3 p : points) {
        lower = {std::min(lower.x, p.x), std::min(lower.y, p.y), 0};
        upper = {std::max(upper.x, p.x), std::max(upper.y, p.y), std::max(upper.z, p.z)};
    }
    return volume_coverage(cameras, points, lower, upper);
}

}  // namespace kinevox
