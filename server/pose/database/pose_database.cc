#include "server/pose/database/pose_database.h"

#include <fmt/format.h>
#include <zstd.h>

#include <algorithm>
#include <cmath>

#include "server/pose/database/silhouette_codec.h"

namespace kinevox {

std::string PoseDatabaseOptions::check() const {
    if (poses < 1 || poses > 20000)
        return fmt::format("pose_database.poses is {}; 1 to 20000 is allowed", poses);
    if (order < 2 || order > kernels::kMaxMomentOrder)
        return fmt::format("pose_database.order is {}; 2 to {} is allowed", order, kernels::kMaxMomentOrder);
    if (side_px < 32 || side_px > 256 || side_px % 8 != 0)
        return fmt::format("pose_database.side_px is {}; a multiple of 8 from 32 to 256 is needed", side_px);
    if (!(half_width_per_stature >= 0.5 && half_width_per_stature <= 1.5))
        return fmt::format("pose_database.half_width_per_stature is {}; 0.5 to 1.5 is allowed",
                           half_width_per_stature);
    if (!(elevation_step_deg >= 2 && elevation_step_deg <= 45))
        return fmt::format("pose_database.elevation_step_deg is {}; 2 to 45 is allowed", elevation_step_deg);
    if (!(inverse_distance_step >= 0.02 && inverse_distance_step <= 2))
        return fmt::format("pose_database.inverse_distance_step is {}; 0.02 to 2 is allowed",
                           inverse_distance_step);
    if (threads < 1 || threads > 256)
        return fmt::format("pose_database.threads is {}; 1 to 256 is allowed", threads);
    return {};
}

int PoseDatabase::nearest_slab(double elevation, double distance_m) const {
    int best = 0;
    double least = 1e300;
    const double step = options.elevation_step_deg * 3.14159265358979323846 / 180;
    for (std::size_t n = 0; n < viewpoints.size(); ++n) {
        const double e = (viewpoints[n].elevation - elevation) / step;
        const double d = (viewpoints[n].inverse_distance - 1 / distance_m) / options.inverse_distance_step;
        if (e * e + d * d < least) least = e * e + d * d, best = static_cast<int>(n);
    }
    return best;
}

void PoseDatabase::encode(const float* moments, std::uint8_t* code) const {
    const int count = values();
    for (int n = 0; n < kernels::kCodeBytes; ++n) {
        const float* row = code_basis.data() + static_cast<std::size_t>(n) * count;
        double sum = 0;
        for (int v = 0; v < count; ++v) sum += static_cast<double>(row[v]) * moments[v];
        const double step = std::round((sum - code_mean[n]) / code_step) + 64;
        code[n] = static_cast<std::uint8_t>(std::clamp(step, 0.0, static_cast<double>(kernels::kCodeMax)));
    }
}

std::vector<std::uint8_t> PoseDatabase::silhouette(int slab, int pose, int bin) const {
    return unpack_silhouette(slabs[slab].silhouettes[pose], options.side_px, bin);
}

absl::Status PoseDatabase::remove(int pose) {
    if (pose < 0 || pose >= pose_count())
        return absl::NotFoundError(
            fmt::format("pose {} is out of range; the database has {}", pose, pose_count()));
    const auto cut = [&](auto& list, std::size_t per_pose) {
        const auto first = list.begin() + static_cast<std::ptrdiff_t>(pose * per_pose);
        list.erase(first, first + static_cast<std::ptrdiff_t>(per_pose));
    };
    if (!poses[pose].user_defined) removed.push_back(poses[pose].label);
    cut(poses, 1);
    cut(body_centres, 1);
    for (Slab& slab : slabs) {
        cut(slab.moments, static_cast<std::size_t>(kernels::kViewBins) * values());
        cut(slab.centres, static_cast<std::size_t>(kernels::kViewBins) * 2);
        cut(slab.codes, static_cast<std::size_t>(kernels::kViewBins) * kernels::kCodeBytes);
        cut(slab.silhouettes, 1);
        slab.search = kernels::MomentSlab::make(slab.codes);
    }
    return absl::OkStatus();
}

absl::Status PoseDatabase::remove(const std::string& label) {
    bool found = false;
    for (int pose = pose_count() - 1; pose >= 0; --pose) {
        if (poses[pose].label != label) continue;
        found = true;
        if (const absl::Status status = remove(pose); !status.ok()) return status;
    }
    if (!found)
        return absl::NotFoundError(
            fmt::format("no pose has the label '{}'; `kinevox poses list` shows the labels", label));
    return absl::OkStatus();
}

Vec3 body_centre(std::span<const BodyCapsule> capsules) {
    Vec3 sum;
    double volume = 0;
    for (const BodyCapsule& c : capsules) {
        const Vec3 a{c.a[0], c.a[1], c.a[2]}, b{c.b[0], c.b[1], c.b[2]};
        const double radius = 0.5 * (c.radius_a + c.radius_b),
                     part = radius * radius * (norm(b - a) + radius);
        sum += (0.5 * part) * (a + b);
        volume += part;
    }
    return volume > 0 ? sum / volume : Vec3{};
}

}  // namespace kinevox
