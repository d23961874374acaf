// Poses and their views: for every pose, relative heading and viewpoint a rendered silhouette, its
// pseudo-Zernike moments and its centre. Paper, section 4, with one change: there an entry holds the four
// silhouettes of one pose, heading and position; here an entry is composed at query time from single views
// keyed by the pose, the body's heading relative to the camera, and the camera's elevation and distance. So
// one database serves any number of cameras, missing ones, and every position in the capture space.
//
// Entries are poses times kHeadings (5 deg). The views behind them are 10 deg apart and interpolated in
// between.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "kernels/moment_search.h"
#include "kernels/moments.h"
#include "server/pose/body_shape.h"
#include "server/pose/database/pose_library.h"

namespace kinevox {

struct PoseDatabaseOptions {
    int poses = 1400;  // library poses; entries are poses times 72 headings
    int order = 10;    // of the moments, 2 to kMaxMomentOrder
    int side_px = 96;  // of the silhouettes, 32 to 256, a multiple of 8
    // Half the width of the views around the body's centre; raised hands are at 0.70.
    double half_width_per_stature = 0.74;
    double elevation_step_deg = 10;      // between viewpoints
    double inverse_distance_step = 0.2;  // 1/m, between viewpoints
    int threads = 1;                     // of the build; the result does not depend on it

    // Empty when valid, else one sentence.
    std::string check() const;
};

// Camera position relative to the subject: elevation above the horizontal through the body's centre, and
// distance.
struct Viewpoint {
    double elevation = 0;         // rad
    double inverse_distance = 0;  // 1/m
    bool operator==(const Viewpoint&) const = default;
};

struct PoseDatabase {
    // One viewpoint's views of all poses. Index of a view: pose * kViewBins + bin.
    struct Slab {
        std::vector<std::int16_t>
            moments;                 // [view][value], times moment_step: scaled by moment_orthonormal_scale()
        std::vector<float> centres;  // [view][2]: of the silhouette, right and down from the body's centre, m
        std::vector<std::string>
            silhouettes;                  // [pose]: kViewBins images of one bit per pixel, compressed by zstd
        std::vector<std::uint8_t> codes;  // [view][kCodeBytes]
        kernels::MomentSlab search;       // made from `codes`
    };

    std::string fingerprint;  // of the inputs of the build
    PoseDatabaseOptions options;
    BodyShape shape;
    std::vector<LibraryPose> poses;
    std::vector<std::string> removed;  // labels of library poses that a user deleted; kept in a rebuild
    std::vector<Vec3> body_centres;    // per pose: of the body from the root, m, heading 0
    std::vector<Viewpoint> viewpoints;
    std::vector<Slab> slabs;  // per viewpoint
    float moment_step = 0;
    // A code is (basis * moments - mean) / code_step + 64, rounded, cut to 0..127: the directions in which
    // the views differ most.
    std::vector<float> code_basis;  // [kCodeBytes][value]
    std::vector<float> code_mean;   // [kCodeBytes]
    float code_step = 0;

    int pose_count() const { return static_cast<int>(poses.size()); }
    std::int64_t entry_count() const { return static_cast<std::int64_t>(poses.size()) * kernels::kHeadings; }
    int values() const { return kernels::moment_values(options.order); }
    double half_width_m() const { return options.half_width_per_stature * shape.stature_m; }

    // The slab of the nearest viewpoint.
    int nearest_slab(double elevation, double distance_m) const;
    void encode(const float* moments, std::uint8_t* code) const;
    // The stored silhouette: side_px * side_px bytes, 0 or 255. Empty where it cannot be decompressed.
    std::vector<std::uint8_t> silhouette(int slab, int pose, int bin) const;

    // Deletes a pose, or all poses with a label. NotFound if there is none.
    absl::Status remove(int pose);
    absl::Status remove(const std::string& label);
};

// Centroid of the body's volume, world frame.
Vec3 body_centre(std::span<const BodyCapsule> capsules);

}  // namespace kinevox
