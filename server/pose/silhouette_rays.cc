#include "server/pose/silhouette_rays.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <vector>

#include "common/median.h"
#include "kernels/distance_map.h"

namespace kinevox {
namespace {

constexpr int kNormalRadius = 3;  // px; half-width of the window from which the normal is computed
constexpr int kMapMargin = 8;     // cells around the silhouette's box

struct BorderPoint {
    float x, y;  // px, between the two pixels
};

struct ContourPoint {
    Vec2 at, normal;      // px; outward
    double contrast = 0;  // grey levels
};

// Midpoints between adjacent inside and outside pixels, in raster order.
void find_border(const std::uint8_t* mask, int width, const kernels::Rect& b, int height,
                 std::vector<BorderPoint>& out) {
    out.clear();
    std::vector<std::uint8_t> is_border(width);
    for (int y = b.y0; y < b.y1; ++y) {
        const std::uint8_t* const row = mask + static_cast<std::ptrdiff_t>(y) * width;
        const std::uint8_t* const above = y > 0 ? row - width : row;
        const std::uint8_t* const below = y + 1 < height ? row + width : row;
        const auto is_outside = [](std::uint8_t pixel) { return static_cast<std::uint8_t>(pixel == 0); };
        for (int x = b.x0; x < b.x1; ++x)
            is_border[x] =
                static_cast<std::uint8_t>(row[x] != 0) & (is_outside(above[x]) | is_outside(below[x]));
        for (int x = std::max(b.x0, 1); x < b.x1; ++x)
            is_border[x] |= static_cast<std::uint8_t>(row[x] != 0) & is_outside(row[x - 1]);
        for (int x = b.x0; x < std::min(b.x1, width - 1); ++x)
            is_border[x] |= static_cast<std::uint8_t>(row[x] != 0) & is_outside(row[x + 1]);
        const auto* const end = is_border.data() + b.x1;
        for (const std::uint8_t* at = is_border.data() + b.x0;
             (at = static_cast<const std::uint8_t*>(std::memchr(at, 1, end - at))); ++at) {
            const auto x = static_cast<int>(at - is_border.data());
            const auto fx = static_cast<float>(x), fy = static_cast<float>(y);
            if (x > 0 && !row[x - 1]) out.push_back({fx - 0.5f, fy});
            if (x + 1 < width && !row[x + 1]) out.push_back({fx + 0.5f, fy});
            if (!above[x]) out.push_back({fx, fy - 0.5f});
            if (!below[x]) out.push_back({fx, fy + 0.5f});
        }
    }
}

// Normal away from the silhouette: opposite to the centroid of its pixels in a window. Length 0 if undefined.
Vec2 outward_normal(const std::uint8_t* mask, int width, int height, BorderPoint p) {
    double sx = 0, sy = 0;
    const int x0 = std::max(0, static_cast<int>(std::ceil(p.x)) - kNormalRadius),
              x1 = std::min(width - 1, static_cast<int>(std::floor(p.x)) + kNormalRadius),
              y0 = std::max(0, static_cast<int>(std::ceil(p.y)) - kNormalRadius),
              y1 = std::min(height - 1, static_cast<int>(std::floor(p.y)) + kNormalRadius);
    for (int y = y0; y <= y1; ++y)
        for (int x = x0; x <= x1; ++x)
            if (mask[static_cast<std::ptrdiff_t>(y) * width + x]) sx += p.x - x, sy += p.y - y;
    const double length = std::hypot(sx, sy);
    if (length < 1e-6) return {};
    return {sx / length, sy / length};
}

// Difference between the two sides of the border, of the channel that differs more: means over three pixels
// along it and two away from it.
double contrast_across(const kernels::ImageView& image, Vec2 at, Vec2 normal) {
    std::array<int, 3> difference{};
    for (const int side : {-1, 1})
        for (int away = 1; away <= 2; ++away)
            for (int along = -1; along <= 1; ++along) {
                const double x = at.x + side * away * normal.x - along * normal.y,
                             y = at.y + side * away * normal.y + along * normal.x;
                const std::uint8_t* const pixel =
                    image.row(std::clamp(static_cast<int>(std::lround(y)), 0, image.height - 1)) +
                    std::ptrdiff_t{image.channels} *
                        std::clamp(static_cast<int>(std::lround(x)), 0, image.width - 1);
                for (int c = 0; c < image.channels; ++c) difference[c] += side * pixel[c];
            }
    int largest = 0;
    for (const int d : difference) largest = std::max(largest, std::abs(d));
    return largest / 6.0;
}

// In dim images all of the border has little contrast. Returns where those that were removed were.
std::vector<Vec2> remove_without_contrast(std::vector<ContourPoint>& points) {
    constexpr double kMinContrast = 8, kMinOfMedian = 0.4;
    std::vector<double> contrasts;
    for (const ContourPoint& point : points) contrasts.push_back(point.contrast);
    std::vector<Vec2> removed;
    if (contrasts.empty()) return removed;
    const double min = std::min(kMinContrast, kMinOfMedian * median_of(contrasts));
    std::erase_if(points, [&](const ContourPoint& point) {
        if (point.contrast < min) removed.push_back(point.at);
        return point.contrast < min;
    });
    return removed;
}

// Numbers of the pixels of a row of cells that are not 0, added to `count`.
void count_pixels(const std::uint8_t* pixels, int columns, int cell, int* count) {
    if (cell == 1)
        for (int c = 0; c < columns; ++c) count[c] += pixels[c] != 0;
    else
        for (int c = 0; c < columns; ++c)
            for (int x = 0; x < cell; ++x) count[c] += pixels[c * cell + x] != 0;
}

}  // namespace

void SilhouetteDistance::build(const std::uint8_t* mask, const std::uint8_t* also, int width, int height,
                               const kernels::Rect& bounds, int side) {
    image_width_ = width, image_height_ = height;
    cell_ = std::max(1, (std::max(bounds.width(), bounds.height()) + side - 1) / side);
    const int margin = kMapMargin * cell_;
    x0_ = std::max(0, bounds.x0 - margin), y0_ = std::max(0, bounds.y0 - margin);
    const int x1 = std::min(width, bounds.x1 + margin), y1 = std::min(height, bounds.y1 + margin);
    columns_ = std::max(1, (x1 - x0_) / cell_), rows_ = std::max(1, (y1 - y0_) / cell_);
    const std::size_t cells = static_cast<std::size_t>(columns_) * rows_;
    distance_.resize(cells);
    shared_.assign(also ? cells : 0, 0);
    // A cell is inside if half of it is.
    thread_local std::vector<std::uint8_t> inside, either;
    thread_local std::vector<int> set, shared;
    inside.resize(cells);
    either.resize(static_cast<std::size_t>(columns_) * cell_);
    for (int r = 0; r < rows_; ++r) {
        set.assign(columns_, 0);
        shared.assign(columns_, 0);
        for (int y = 0; y < cell_; ++y) {
            const std::ptrdiff_t at = static_cast<std::ptrdiff_t>(y0_ + r * cell_ + y) * width + x0_;
            const std::uint8_t* pixels = mask + at;
            if (also) {
                count_pixels(also + at, columns_, cell_, shared.data());
                for (std::size_t x = 0; x < either.size(); ++x) either[x] = pixels[x] | also[at + x];
                pixels = either.data();
            }
            count_pixels(pixels, columns_, cell_, set.data());
        }
        const std::size_t first = static_cast<std::size_t>(r) * columns_;
        for (int c = 0; c < columns_; ++c) inside[first + c] = 2 * set[c] >= cell_ * cell_;
        if (also)
            for (int c = 0; c < columns_; ++c) shared_[first + c] = 2 * shared[c] > cell_ * cell_;
    }
    kernels::signed_distances(inside.data(), columns_, rows_, distance_.data());
    for (float& d : distance_) d *= static_cast<float>(cell_);
}

std::optional<double> SilhouetteDistance::at(Vec2 p) const {
    if (distance_.empty() ||
        !(p.x > -0.5 && p.y > -0.5 && p.x < image_width_ - 0.5 && p.y < image_height_ - 0.5))
        return std::nullopt;
    const double half = 0.5 * (cell_ - 1);
    const double gx = (p.x - x0_ - half) / cell_, gy = (p.y - y0_ - half) / cell_;
    const double cx = std::clamp(gx, 0.0, columns_ - 1.0), cy = std::clamp(gy, 0.0, rows_ - 1.0);
    const int i = std::min(static_cast<int>(cx), std::max(0, columns_ - 2)),
              j = std::min(static_cast<int>(cy), std::max(0, rows_ - 2));
    const int i1 = std::min(i + 1, columns_ - 1), j1 = std::min(j + 1, rows_ - 1);
    const double u = cx - i, v = cy - j;
    const auto cell = [&](int x, int y) -> double {
        return distance_[static_cast<std::size_t>(y) * columns_ + x];
    };
    const double d00 = cell(i, j), d10 = cell(i1, j), d01 = cell(i, j1), d11 = cell(i1, j1);
    const double distance = (1 - v) * ((1 - u) * d00 + u * d10) + v * ((1 - u) * d01 + u * d11);
    const bool in_map = gx == cx && gy == cy;
    return in_map ? distance : distance - std::hypot((gx - cx) * cell_, (gy - cy) * cell_);
}

kernels::DistanceMapView SilhouetteDistance::map() const {
    return {distance_.empty() ? nullptr : distance_.data(), columns_, rows_, cell_, x0_, y0_};
}

bool SilhouetteDistance::is_shared(Vec2 p) const {
    if (shared_.empty()) return false;
    const auto c = static_cast<int>(std::floor((p.x - x0_ + 0.5) / cell_)),
               r = static_cast<int>(std::floor((p.y - y0_ + 0.5) / cell_));
    return c >= 0 && r >= 0 && c < columns_ && r < rows_ &&
           shared_[static_cast<std::size_t>(r) * columns_ + c] != 0;
}

bool SilhouetteRays::shows_alone(Vec3 in_world) const {
    if (!camera) return false;
    const std::optional<Vec2> pixel = camera->project(in_world);
    return pixel && pixel->x > -0.5 && pixel->y > -0.5 && pixel->x < camera->width - 0.5 &&
           pixel->y < camera->height - 0.5 && !distance.is_shared(*pixel);
}

std::optional<double> SilhouetteRays::inside_m(Vec3 in_world) const {
    if (!camera) return std::nullopt;
    const std::optional<Vec2> pixel = camera->project(in_world);
    const std::optional<double> inside_px = pixel ? distance.at(*pixel) : std::nullopt;
    if (!inside_px) return std::nullopt;
    const double depth = (camera->camera_from_world * in_world).z;
    return *inside_px * (2 * depth / (camera->fx + camera->fy));
}

void PixelList::assign(std::span<const Vec2> points) {
    std::vector<Vec2> sorted(points.begin(), points.end());
    std::ranges::stable_sort(sorted, {}, &Vec2::y);
    size_ = sorted.size();
    const std::size_t whole = (size_ + kLanes - 1) / kLanes * kLanes;
    x_.assign(whole, std::numeric_limits<float>::infinity());
    y_.assign(whole, sorted.empty() ? 0 : static_cast<float>(sorted.back().y));
    for (std::size_t n = 0; n < size_; ++n)
        x_[n] = static_cast<float>(sorted[n].x), y_[n] = static_cast<float>(sorted[n].y);
}

// From the pixel's row on upwards and downwards, until the rows alone are too far.
float PixelList::squared_distance(Vec2 pixel, float limit) const {
    const float px = static_cast<float>(pixel.x), py = static_cast<float>(pixel.y);
    float best = limit;
    const auto look_at = [&](std::size_t first) {
        std::array<float, kLanes> square;
        for (std::size_t k = 0; k < kLanes; ++k) {
            const float dx = x_[first + k] - px, dy = y_[first + k] - py;
            square[k] = dx * dx + dy * dy;
        }
        for (const float s : square) best = s < best ? s : best;
    };
    const auto start =
        static_cast<std::size_t>(std::ranges::lower_bound(y_, py) - y_.begin()) / kLanes * kLanes;
    for (std::size_t first = start; first < y_.size(); first += kLanes) {
        const float below = y_[first] - py;
        if (below > 0 && below * below >= best) break;
        look_at(first);
    }
    for (std::size_t end = start; end > 0; end -= kLanes) {
        const float above = py - y_[end - 1];
        if (above * above >= best) break;
        look_at(end - kLanes);
    }
    return best;
}

bool SilhouetteRays::is_nearest_to_border_without_contrast(Vec2 pixel) const {
    if (border_without_contrast.size() == 0) return false;
    const float with_contrast = border.squared_distance(pixel);
    // A tie is without contrast.
    const float limit = std::nextafter(with_contrast, std::numeric_limits<float>::infinity());
    return border_without_contrast.squared_distance(pixel, limit) < limit;
}

bool shows_others(std::span<const SilhouetteRays> views) {
    return std::ranges::any_of(
        views, [](const SilhouetteRays& view) { return view.camera && view.distance.has_shared(); });
}

bool is_among_others(std::span<const SilhouetteRays> views, Vec3 in_world) {
    constexpr int kMinAlone = 2;
    return shows_others(views) &&
           std::ranges::count_if(views, [&](const auto& v) { return v.shows_alone(in_world); }) < kMinAlone;
}

void read_silhouette(const Camera& camera, const kernels::Silhouettes& s, const SilhouetteRayOptions& options,
                     SilhouetteRays& out, const kernels::ImageView& image, const ForegroundPart* shared) {
    if (shared && shared->box.empty()) shared = nullptr;
    out.camera = nullptr;
    for (int k = 0; k < 3; ++k) out.contour.direction[k].clear(), out.contour.outward[k].clear();
    if (s.sharp_pixels <= 0 || s.bounds.empty()) return;
    std::vector<BorderPoint> border;
    find_border(s.sharp.data(), s.width, s.bounds, s.height, border);
    if (shared)
        std::erase_if(border, [&](const BorderPoint& p) {  // either of its two pixels
            const auto at = [&](float x, float y) {
                return shared->mask[static_cast<std::size_t>(y) * s.width + static_cast<std::size_t>(x)] != 0;
            };
            return at(std::floor(p.x), std::floor(p.y)) || at(std::ceil(p.x), std::ceil(p.y));
        });
    const std::size_t wanted = static_cast<std::size_t>(options.contour_rays);
    const std::size_t count = std::min(wanted, border.size());
    std::vector<ContourPoint> points;
    for (std::size_t k = 0; k < count; ++k) {
        const BorderPoint p = border[border.size() * (2 * k + 1) / (2 * count)];
        const Vec2 at{p.x, p.y}, normal = outward_normal(s.sharp.data(), s.width, s.height, p);
        if (normal.x == 0 && normal.y == 0) continue;
        points.push_back({at, normal, image.data ? contrast_across(image, at, normal) : 0});
    }
    std::vector<Vec2> used, not_used;
    if (image.data) {
        not_used = remove_without_contrast(points);
        for (const ContourPoint& point : points) used.push_back(point.at);
    }
    out.border.assign(used), out.border_without_contrast.assign(not_used);
    out.contour.origin_in_world = camera.centre_in_world();
    const Mat3 world_from_camera = camera.camera_from_world.rotation.transposed();
    for (const auto& [at, normal, contrast] : points) {
        const Vec3 direction = camera.ray_through(at).direction_in_world;
        // In the image's plane x is right and y down, as in the camera's frame.
        Vec3 outward = world_from_camera * Vec3{normal.x, normal.y, 0};
        outward = normalized(outward - dot(outward, direction) * direction);
        const double d[3] = {direction.x, direction.y, direction.z}, n[3] = {outward.x, outward.y, outward.z};
        for (int axis = 0; axis < 3; ++axis) {
            out.contour.direction[axis].push_back(static_cast<float>(d[axis]));
            out.contour.outward[axis].push_back(static_cast<float>(n[axis]));
        }
    }
    out.distance.build(s.sharp.data(), shared ? shared->mask.data() : nullptr, s.width, s.height,
                       shared ? union_of(s.bounds, shared->box) : s.bounds, options.distance_map_side);
    out.camera = &camera;
}

}  // namespace kinevox
