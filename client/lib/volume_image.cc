#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "client/lib/image.h"

namespace kinevox::client {
namespace {

// Which voxels are occupied, in a dense box: what normals are made of.
class Occupancy {
  public:
    explicit Occupancy(const Volume& volume) : size_(volume.grid.size) {
        bits_.resize(static_cast<std::size_t>(size_[0]) * static_cast<std::size_t>(size_[1]) *
                     static_cast<std::size_t>(size_[2]));
        for (const VolumeBrick& brick : volume.bricks)
            for (int z = 0; z < 8; ++z)
                for (int bit = 0; bit < 64; ++bit)
                    if (brick.occupancy[static_cast<std::size_t>(z)] >> bit & 1)
                        bits_[at(8 * brick.x + bit % 8, 8 * brick.y + bit / 8, 8 * brick.z + z)] = true;
    }
    bool operator()(int i, int j, int k) const {
        return i >= 0 && j >= 0 && k >= 0 && i < size_[0] && j < size_[1] && k < size_[2] &&
               bits_[at(i, j, k)];
    }

    // Outwards: away from the occupied voxels of the neighbourhood.
    Vec3 normal(const VoxelIndex& v) const {
        constexpr int kRadius = 3;
        Vec3 sum;
        for (int dk = -kRadius; dk <= kRadius; ++dk)
            for (int dj = -kRadius; dj <= kRadius; ++dj)
                for (int di = -kRadius; di <= kRadius; ++di)
                    if (di * di + dj * dj + dk * dk <= kRadius * kRadius &&
                        (*this)(v.i + di, v.j + dj, v.k + dk))
                        sum += Vec3{-1.0 * di, -1.0 * dj, -1.0 * dk};
        return norm(sum) > 0 ? normalized(sum) : Vec3{0, 0, 1};
    }

  private:
    std::size_t at(int i, int j, int k) const {
        return (static_cast<std::size_t>(k) * static_cast<std::size_t>(size_[1]) +
                static_cast<std::size_t>(j)) *
                   static_cast<std::size_t>(size_[0]) +
               static_cast<std::size_t>(i);
    }
    std::array<int, 3> size_;
    std::vector<bool> bits_;
};

// An image with the depth of the nearest surface.
class Canvas {
  public:
    Canvas(int width, int height, Rgb background) : depth_(static_cast<std::size_t>(width * height), kFar) {
        image_ = {width, height, 3, {}};
        image_.data.reserve(3 * depth_.size());
        for (std::size_t i = 0; i < depth_.size(); ++i)
            image_.data.insert(image_.data.end(), {background.r, background.g, background.b});
    }

    void fill(int x0, int y0, int x1, int y1, double depth, Rgb colour) {  // both ends included
        for (int y = std::max(0, y0); y <= std::min(image_.height - 1, y1); ++y)
            for (int x = std::max(0, x0); x <= std::min(image_.width - 1, x1); ++x) {
                const auto i = static_cast<std::size_t>(y * image_.width + x);
                if (depth >= depth_[i]) continue;
                depth_[i] = depth;
                image_.data[3 * i] = colour.r;
                image_.data[3 * i + 1] = colour.g;
                image_.data[3 * i + 2] = colour.b;
            }
    }
    Image take() { return std::move(image_); }

  private:
    static constexpr double kFar = std::numeric_limits<double>::infinity();
    Image image_;
    std::vector<double> depth_;
};

struct Box {
    Vec3 low, high;  // m, world
};

// Empty (low above high) without a brick.
Box bounds_of(std::span<const Volume> volumes) {
    Box box{{1e9, 1e9, 1e9}, {-1e9, -1e9, -1e9}};
    for (const Volume& volume : volumes) {
        const double brick_m = 8 * volume.grid.voxel_m;
        for (const VolumeBrick& brick : volume.bricks) {
            const Vec3 corner =
                volume.grid.origin_in_world + brick_m * Vec3{1.0 * brick.x, 1.0 * brick.y, 1.0 * brick.z};
            box.low = {std::min(box.low.x, corner.x), std::min(box.low.y, corner.y),
                       std::min(box.low.z, corner.z)};
            box.high = {std::max(box.high.x, corner.x + brick_m), std::max(box.high.y, corner.y + brick_m),
                        std::max(box.high.z, corner.z + brick_m)};
        }
    }
    return box;
}

Rgb shaded(Rgb colour, double light) {
    const auto channel = [&](std::uint8_t c) {
        return static_cast<std::uint8_t>(std::min(255.0, c * light));
    };
    return {channel(colour.r), channel(colour.g), channel(colour.b)};
}

void draw_floor(const Box& box, const Camera& camera, const RenderOptions& options, Canvas& canvas) {
    constexpr double kStep = 0.5, kAround = 2.0, kDot = 0.005;
    const Rgb colour = shaded(options.background, 2.4);
    const auto down = [](double v) { return kStep * std::floor(v / kStep); };
    const double x0 = down(box.low.x - kAround), x1 = down(box.high.x + kAround) + kStep;
    const double y0 = down(box.low.y - kAround), y1 = down(box.high.y + kAround) + kStep;
    const auto dot_at = [&](double x, double y) {
        const Vec3 point{x, y, 0};
        if (const auto pixel = camera.project(point)) {
            const double depth = (camera.camera_from_world * point).z;
            if (depth < 0.2 || std::abs(pixel->x) > 1e5 || std::abs(pixel->y) > 1e5) return;
            const int px = static_cast<int>(std::lround(pixel->x)),
                      py = static_cast<int>(std::lround(pixel->y));
            canvas.fill(px, py, px, py, depth, colour);
        }
    };
    for (double x = x0; x <= x1 + 1e-9; x += kStep)
        for (double y = y0; y <= y1; y += kDot) dot_at(x, y);
    for (double y = y0; y <= y1 + 1e-9; y += kStep)
        for (double x = x0; x <= x1; x += kDot) dot_at(x, y);
}

void draw_volume(const Volume& volume, const Camera& camera, const RenderOptions& options, Canvas& canvas) {
    const Occupancy occupied(volume);
    const std::vector<VoxelIndex> voxels = surface_voxels(volume);
    const bool coloured = volume.colours.size() == voxels.size();
    const Vec3 eye = camera.centre_in_world();
    const Mat3 world_from_camera = camera.camera_from_world.rotation.transposed();
    // The light stands above the camera's left shoulder.
    const Vec3 to_light = normalized(world_from_camera * Vec3{-0.45, -0.6, -0.66});
    // Half the box around a unit cube's projection: no gaps, through which the far side would be seen.
    const Mat3& r = camera.camera_from_world.rotation;
    const double half_across = 0.5 * (std::abs(r(0, 0)) + std::abs(r(0, 1)) + std::abs(r(0, 2)));
    const double half_down = 0.5 * (std::abs(r(1, 0)) + std::abs(r(1, 1)) + std::abs(r(1, 2)));
    for (std::size_t v = 0; v < voxels.size(); ++v) {
        const VoxelIndex& index = voxels[v];
        const double edge = volume.grid.voxel_m;
        const Vec3 centre =
            volume.grid.origin_in_world + edge * Vec3{index.i + 0.5, index.j + 0.5, index.k + 0.5};
        const auto pixel = camera.project(centre);
        const double depth = (camera.camera_from_world * centre).z;
        if (!pixel || depth < 0.05) continue;
        const double half_x_px = half_across * edge * camera.fx / depth,
                     half_y_px = half_down * edge * camera.fy / depth;
        const Vec3 normal = occupied.normal(index);
        const double facing = std::max(0.0, dot(normal, to_light));
        const double rim = std::max(0.0, dot(normal, normalized(eye - centre)));
        const double light = options.ambient * (0.6 + 0.4 * rim) + (1.25 - options.ambient) * facing;
        const Rgb colour = shaded(coloured ? volume.colours[v] : options.uncoloured, light);
        canvas.fill(static_cast<int>(std::ceil(pixel->x - half_x_px)),
                    static_cast<int>(std::ceil(pixel->y - half_y_px)),
                    static_cast<int>(std::floor(pixel->x + half_x_px)),
                    static_cast<int>(std::floor(pixel->y + half_y_px)), depth, colour);
    }
}

}  // namespace

Image render_volumes(std::span<const Volume> volumes, const Camera& camera, const RenderOptions& options) {
    Canvas canvas(camera.width, camera.height, options.background);
    const Box box = bounds_of(volumes);
    if (box.low.x > box.high.x) return canvas.take();
    if (options.floor_grid) draw_floor(box, camera, options, canvas);
    for (const Volume& volume : volumes) draw_volume(volume, camera, options, canvas);
    return canvas.take();
}

Image render_volume(const Volume& volume, const Camera& camera, const RenderOptions& options) {
    return render_volumes({&volume, 1}, camera, options);
}

Camera scaled(const Camera& camera, double scale) {
    Camera out = camera;
    out.width = std::max(1, static_cast<int>(std::lround(camera.width * scale)));
    out.height = std::max(1, static_cast<int>(std::lround(camera.height * scale)));
    out.fx = camera.fx * scale;
    out.fy = camera.fy * scale;
    out.cx = (camera.cx + 0.5) * scale - 0.5;  // the first pixel's centre is (0, 0), its corner (-0.5, -0.5)
    out.cy = (camera.cy + 0.5) * scale - 0.5;
    return out;
}

Window window_around(std::span<const Volume> volumes, const Camera& camera) {
    double x0 = 1e9, x1 = -1e9, y0 = 1e9, y1 = -1e9;
    for (const Volume& volume : volumes)
        for (const VoxelIndex& v : surface_voxels(volume)) {
            const auto pixel = camera.project(volume.grid.origin_in_world +
                                              volume.grid.voxel_m * Vec3{v.i + 0.5, v.j + 0.5, v.k + 0.5});
            if (!pixel) continue;
            x0 = std::min(x0, pixel->x), x1 = std::max(x1, pixel->x);
            y0 = std::min(y0, pixel->y), y1 = std::max(y1, pixel->y);
        }
    if (x0 > x1 || x1 < 0 || y1 < 0 || x0 >= camera.width || y0 >= camera.height)
        return {0, 0, camera.width, camera.height};
    const int side = static_cast<int>(std::clamp(std::max(2 * (y1 - y0), 1.3 * (x1 - x0)), 16.0, 1e5));
    Window window;
    window.width = std::min(side, camera.width);
    window.height = std::min(side, camera.height);
    window.x =
        std::clamp(static_cast<int>(0.5 * (x0 + x1)) - window.width / 2, 0, camera.width - window.width);
    window.y =
        std::clamp(static_cast<int>(0.5 * (y0 + y1)) - window.height / 2, 0, camera.height - window.height);
    return window;
}

Camera cropped(const Camera& camera, const Window& window) {
    Camera out = camera;
    out.width = window.width;
    out.height = window.height;
    out.cx -= window.x;
    out.cy -= window.y;
    return out;
}

Image cropped(const Image& image, const Window& window) {
    Image out{window.width, window.height, image.channels, {}};
    out.data.reserve(static_cast<std::size_t>(out.width * out.height * out.channels));
    for (int y = window.y; y < window.y + window.height; ++y) {
        const auto row =
            image.data.begin() + static_cast<std::ptrdiff_t>((y * image.width + window.x) * image.channels);
        out.data.insert(out.data.end(), row, row + window.width * image.channels);
    }
    return out;
}

Camera oblique_camera(std::span<const Volume> volumes, const Vec3& towards_in_world, double azimuth,
                      double elevation, int width, int height) {
    const Box box = bounds_of(volumes);
    const Vec3 middle = 0.5 * (box.low + box.high);
    const double from = std::atan2(towards_in_world.y - middle.y, towards_in_world.x - middle.x) + azimuth;
    const Vec3 backward{std::cos(elevation) * std::cos(from), std::cos(elevation) * std::sin(from),
                        std::sin(elevation)};  // from the volume to the eye
    const Vec3 right = normalized(cross(-backward, Vec3{0, 0, 1}));
    const Vec3 down = cross(-backward, right);
    Camera camera;
    camera.name = "oblique";
    camera.width = width;
    camera.height = height;
    camera.fx = camera.fy = 1.6 * height;
    camera.cx = 0.5 * (width - 1);
    camera.cy = 0.5 * (height - 1);
    // Far enough that the box's sphere, or for something tall its height, fits with a margin.
    const Vec3 half = 0.5 * (box.high - box.low);
    const double distance =
        1.2 * camera.fy *
        std::max(std::hypot(half.x, half.y) / (0.5 * width), norm(half) * 0.9 / (0.5 * height));
    camera.camera_from_world.rotation.m = {right.x, right.y,     right.z,     down.x,     down.y,
                                           down.z,  -backward.x, -backward.y, -backward.z};
    camera.camera_from_world.translation =
        -(camera.camera_from_world.rotation * (middle + distance * backward));
    return camera;
}

Image side_by_side(const std::vector<Image>& images, int gap_px, Rgb background) {
    Image out{0, 0, 3, {}};
    for (const Image& image : images) {
        out.width += image.width + (out.width > 0 ? gap_px : 0);
        out.height = std::max(out.height, image.height);
    }
    for (int i = 0; i < out.width * out.height; ++i)
        out.data.insert(out.data.end(), {background.r, background.g, background.b});
    int x0 = 0;
    for (const Image& image : images) {
        for (int y = 0; y < image.height; ++y)
            for (int x = 0; x < image.width; ++x)
                for (int c = 0; c < 3; ++c) {
                    const int from =
                        image.channels == 1 ? y * image.width + x : 3 * (y * image.width + x) + c;
                    out.data[static_cast<std::size_t>(3 * (y * out.width + x0 + x) + c)] =
                        image.data[static_cast<std::size_t>(from)];
                }
        x0 += image.width + gap_px;
    }
    return out;
}

Image scaled_to_height(const Image& image, int height) {
    const double step = static_cast<double>(image.height) / height;
    Image out{std::max(1, static_cast<int>(std::lround(image.width / step))), height, 3, {}};
    out.data.resize(static_cast<std::size_t>(3 * out.width * out.height));
    for (int y = 0; y < out.height; ++y)
        for (int x = 0; x < out.width; ++x) {
            const double fx = std::clamp((x + 0.5) * step - 0.5, 0.0, image.width - 1.0);
            const double fy = std::clamp((y + 0.5) * step - 0.5, 0.0, image.height - 1.0);
            const int x0 = static_cast<int>(fx), y0 = static_cast<int>(fy);
            const int x1 = std::min(x0 + 1, image.width - 1), y1 = std::min(y0 + 1, image.height - 1);
            const double u = fx - x0, v = fy - y0;
            for (int c = 0; c < 3; ++c) {
                const auto at = [&](int px, int py) {
                    const int i =
                        image.channels == 1 ? py * image.width + px : 3 * (py * image.width + px) + c;
                    return static_cast<double>(image.data[static_cast<std::size_t>(i)]);
                };
                const double value = (1 - v) * ((1 - u) * at(x0, y0) + u * at(x1, y0)) +
                                     v * ((1 - u) * at(x0, y1) + u * at(x1, y1));
                out.data[static_cast<std::size_t>(3 * (y * out.width + x) + c)] =
                    static_cast<std::uint8_t>(std::lround(value));
            }
        }
    return out;
}

}  // namespace kinevox::client
