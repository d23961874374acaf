// How many bodies of a person's size are in the room: a coarse hull of all moving foreground, counted by its
// separate footprints on the floor.
#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

#include "server/quality/samples.h"

namespace kinevox::quality {
namespace {

constexpr double kCell_m = 0.08;
constexpr double kAround_m = 1, kMaxSide_m = 20;  // of the room around the cameras
constexpr double kMinZ_m = 0, kMaxZ_m = 2.3;
constexpr int kMinColumnCells = 3;           // of a column that belongs to a footprint
constexpr double kMinPerson_m3 = 0.025;      // hull cells are larger than the body
constexpr double kMinSecondFraction = 0.35;  // of the largest body's volume
constexpr double kMinHeight_m = 0.6;
constexpr std::size_t kMaxFrameSets = 20;

struct Room {
    Vec3 origin;
    std::array<int, 3> size{};
    std::size_t cells() const { return static_cast<std::size_t>(size[0]) * size[1] * size[2]; }
};

Room room_of(const std::vector<Camera>& cameras) {
    Vec3 low = cameras[0].centre_in_world(), high = low;
    for (const Camera& camera : cameras) {
        const Vec3 at = camera.centre_in_world();
        low.x = std::min(low.x, at.x), low.y = std::min(low.y, at.y);
        high.x = std::max(high.x, at.x), high.y = std::max(high.y, at.y);
    }
    Room room;
    room.origin = {low.x - kAround_m, low.y - kAround_m, kMinZ_m};
    const auto cells = [](double side_m) {
        return static_cast<int>(std::ceil(std::clamp(side_m, kCell_m, kMaxSide_m) / kCell_m));
    };
    room.size = {cells(high.x - low.x + 2 * kAround_m), cells(high.y - low.y + 2 * kAround_m),
                 cells(kMaxZ_m - kMinZ_m)};
    return room;
}

// Per cell the index of its pixel in a camera, -1 where the camera does not see it.
std::vector<std::int32_t> pixels_of(const Room& room, const Camera& camera) {
    std::vector<std::int32_t> out(room.cells(), -1);
    std::size_t n = 0;
    for (int z = 0; z < room.size[2]; ++z)
        for (int y = 0; y < room.size[1]; ++y)
            for (int x = 0; x < room.size[0]; ++x, ++n) {
                const auto pixel =
                    camera.project({room.origin.x + (x + 0.5) * kCell_m, room.origin.y + (y + 0.5) * kCell_m,
                                    room.origin.z + (z + 0.5) * kCell_m});
                if (!pixel) continue;
                const long u = std::lround(pixel->x), v = std::lround(pixel->y);
                if (u >= 0 && v >= 0 && u < camera.width && v < camera.height)
                    out[n] = static_cast<std::int32_t>(v * camera.width + u);
            }
    return out;
}

// Volumes of the separate bodies, m3, the largest first.
std::vector<double> bodies_of(const Room& room, const std::vector<std::uint8_t>& occupied) {
    cv::Mat columns = cv::Mat::zeros(room.size[1], room.size[0], CV_32S), top = columns.clone();
    std::size_t n = 0;
    for (int z = 0; z < room.size[2]; ++z)
        for (int y = 0; y < room.size[1]; ++y)
            for (int x = 0; x < room.size[0]; ++x, ++n)
                if (occupied[n]) ++columns.at<int>(y, x), top.at<int>(y, x) = z + 1;
    cv::Mat footprint = columns >= kMinColumnCells, labels;
    const int count = cv::connectedComponents(footprint, labels, 8, CV_32S);
    std::vector<double> volumes(count, 0), heights(count, 0);
    for (int y = 0; y < labels.rows; ++y)
        for (int x = 0; x < labels.cols; ++x) {
            const int label = labels.at<int>(y, x);
            if (label == 0) continue;
            volumes[label] += columns.at<int>(y, x) * kCell_m * kCell_m * kCell_m;
            heights[label] = std::max(heights[label], top.at<int>(y, x) * kCell_m);
        }
    std::vector<double> out;
    for (int i = 1; i < count; ++i)
        if (volumes[i] >= kMinPerson_m3 && heights[i] >= kMinHeight_m) out.push_back(volumes[i]);
    std::sort(out.rbegin(), out.rend());
    return out;
}

}  // namespace

void measure_people(const Samples& seen, const std::vector<cv::Mat>& still, Measurements& out) {
    const std::size_t camera_count = seen.cameras.size();
    const Room room = room_of(seen.cameras);
    std::vector<std::vector<std::int32_t>> pixels(camera_count);
    oneapi::tbb::parallel_for(std::size_t{0}, camera_count,
                              [&](std::size_t c) { pixels[c] = pixels_of(room, seen.cameras[c]); });
    const int min_cameras = camera_count < 3 ? 2 : 3;
    const std::size_t step = std::max<std::size_t>(1, seen.samples.size() / kMaxFrameSets);
    std::vector<char> several((seen.samples.size() + step - 1) / step, 0), merged = several;
    oneapi::tbb::parallel_for(std::size_t{0}, several.size(), [&](std::size_t n) {
        const Sample& sample = seen.samples[n * step];
        std::vector<cv::Mat> moving(camera_count);
        for (std::size_t c = 0; c < camera_count; ++c)
            if (!sample.views[c].grey.empty()) moving[c] = sample.views[c].foreground & ~still[c];
        std::vector<std::uint8_t> occupied(room.cells(), 0);
        for (std::size_t cell = 0; cell < occupied.size(); ++cell) {
            int inside = 0;
            bool outside = false;
            for (std::size_t c = 0; c < camera_count && !outside; ++c) {
                const std::int32_t pixel = pixels[c][cell];
                if (pixel < 0 || moving[c].empty()) continue;
                if (moving[c].data[pixel])
                    ++inside;
                else
                    outside = true;
            }
            occupied[cell] = !outside && inside >= min_cameras;
        }
        const std::vector<double> bodies = bodies_of(room, occupied);
        several[n] = bodies.size() > 1 && bodies[1] >= kMinSecondFraction * bodies[0];
        merged[n] = several[n] && !sample.are_separated;
    });
    const auto fraction = [](const std::vector<char>& flags) {
        return static_cast<double>(std::ranges::count(flags, 1)) /
               static_cast<double>(std::max<std::size_t>(1, flags.size()));
    };
    out.several_people_fraction = fraction(several);
    out.merged_people_fraction = fraction(merged);
}

}  // namespace kinevox::quality
