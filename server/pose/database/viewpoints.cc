// Viewpoints of the cameras on a person, and the fingerprint of a database.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <map>
#include <numbers>
#include <stdexcept>

#include "kernels/shared/camera.h"
#include "server/pose/database/aimed_view.h"
#include "server/pose/database/database_builder.h"

namespace kinevox {
namespace {

constexpr double kMiddleHeight_m = 0.95, kGridStep_m = 0.5, kNearest_m = 1.2, kFarthest_m = 16;

std::uint64_t mix(std::uint64_t hash, const void* bytes, std::size_t size) {  // FNV-1a
    const auto* byte = static_cast<const unsigned char*>(bytes);
    for (std::size_t n = 0; n < size; ++n) hash = (hash ^ byte[n]) * 1099511628211ull;
    return hash;
}

}  // namespace

std::vector<Viewpoint> viewpoints_of(std::span<const kernels::CameraModel> cameras,
                                     const PoseDatabaseOptions& options) {
    if (cameras.empty()) throw std::invalid_argument("pose database: no camera; calibrate at least one");
    std::vector<kernels::Projector> projectors;
    std::vector<Vec3> eyes;
    double x0 = 1e9, x1 = -1e9, y0 = 1e9, y1 = -1e9;
    for (const kernels::CameraModel& camera : cameras) {
        projectors.push_back(kernels::make_projector(camera, "pose database: camera"));
        eyes.push_back(camera_centre(camera));
        x0 = std::min(x0, eyes.back().x), x1 = std::max(x1, eyes.back().x);
        y0 = std::min(y0, eyes.back().y), y1 = std::max(y1, eyes.back().y);
    }
    const double margin = cameras.size() < 3 ? kFarthest_m : 8;
    x0 -= margin, x1 += margin, y0 -= margin, y1 += margin;
    const std::size_t needed = std::min<std::size_t>(cameras.size(), 2);
    const double step = options.elevation_step_deg * std::numbers::pi / 180;
    std::map<std::pair<int, int>, int> seen;  // count per step of elevation and inverse distance
    int all = 0;
    for (double y = y0; y <= y1; y += kGridStep_m) {
        for (double x = x0; x <= x1; x += kGridStep_m) {
            std::vector<std::pair<int, int>> here;
            for (std::size_t n = 0; n < cameras.size(); ++n) {
                const Vec3 out = eyes[n] - Vec3{x, y, kMiddleHeight_m};
                const double distance = norm(out);
                float u, v;
                const kernels::Projector& p = projectors[n];
                if (distance < kNearest_m || distance > kFarthest_m) continue;
                if (!kernels::to_pixel(p,
                                       kernels::to_camera(p, static_cast<float>(x), static_cast<float>(y),
                                                          static_cast<float>(kMiddleHeight_m)),
                                       u, v))
                    continue;
                if (u < 0 || v < 0 || u > static_cast<float>(p.width - 1) ||
                    v > static_cast<float>(p.height - 1))
                    continue;
                const double elevation = std::atan2(out.z, std::hypot(out.x, out.y));
                here.emplace_back(
                    static_cast<int>(std::lround(elevation / step)),
                    static_cast<int>(std::lround(1 / distance / options.inverse_distance_step)));
            }
            if (here.size() < needed) continue;
            for (const auto& cell : here) ++seen[cell], ++all;
        }
    }
    if (all == 0)
        throw std::invalid_argument(
            "pose database: no position is seen by two cameras; check the calibration");
    std::vector<Viewpoint> out;
    for (const auto& [cell, count] : seen) {
        if (count * 100 < all) continue;  // rare; the neighbouring viewpoint is used
        const double inverse =
            std::max(cell.second * options.inverse_distance_step, 0.5 / kFarthest_m + 0.05);
        out.push_back({cell.first * step, inverse});
    }
    return out;
}

std::string database_fingerprint(std::span<const kernels::CameraModel> cameras, const BodyShape& shape,
                                 const PoseDatabaseOptions& options) {
    std::uint64_t hash = 14695981039346656037ull;
    // The cameras determine only the viewpoints; the same viewpoints give the same database.
    for (const Viewpoint& v : viewpoints_of(cameras, options)) {
        hash = mix(hash, &v.elevation, sizeof v.elevation);
        hash = mix(hash, &v.inverse_distance, sizeof v.inverse_distance);
    }
    hash = mix(hash, &shape.stature_m, sizeof shape.stature_m);
    hash = mix(hash, shape.lengths_m.data(), sizeof shape.lengths_m);
    const double numbers[] = {static_cast<double>(options.poses), static_cast<double>(options.order),
                              static_cast<double>(options.side_px), options.half_width_per_stature,
                              static_cast<double>(kPoseLibraryVersion)};
    hash = mix(hash, numbers, sizeof numbers);
    return fmt::format("{:016x}", hash);
}

}  // namespace kinevox
