#include "server/pipeline/subject_views.h"

#include <algorithm>

#include "common/geometry.h"
#include "kernels/projection.h"
#include "server/pipeline/convert.h"
#include "server/pipeline/for_each_camera.h"
#include "server/pipeline/tracking/cone_box.h"
#include "server/pose/main_body.h"

namespace kinevox {
namespace {

// The projections are dilated by this fraction of the image height: a silhouette is up to a voxel and its own
// error wider than the volume that it carved.
constexpr int kDilation = 100;

struct Projection {
    std::vector<std::uint8_t> mask;
    kernels::Rect box;
    double distance_m = 0;  // of the volume's centre from the camera
};

}  // namespace

void separate_subjects(const std::vector<Camera>& cameras, const std::vector<kernels::CameraModel>& models,
                       std::span<const kernels::Silhouettes> silhouettes,
                       std::span<const kernels::VoxelVolume* const> shapes,
                       std::span<SubjectViews* const> out) {
    for (SubjectViews* const views : out) {
        views->own.resize(cameras.size());
        views->shared.assign(cameras.size(), {});
        views->hidden_fraction.assign(cameras.size(), 0);
    }
    for_each_camera(cameras.size(), [&](std::size_t c) {
        const kernels::Silhouettes& seen = silhouettes[c];
        if (seen.sharp.empty()) {
            for (SubjectViews* const views : out) views->own[c] = {};
            return;
        }
        std::vector<Projection> projections(shapes.size());
        const float still[3] = {0, 0, 0};
        for (std::size_t k = 0; k < shapes.size(); ++k) {
            Projection& p = projections[k];
            p.mask.resize(seen.sharp.size());
            kernels::project_volume(*shapes[k], models[c], still, std::max(1, seen.height / kDilation),
                                    p.mask.data(), p.box);
            p.distance_m = norm(centre_of(*shapes[k]).value_or(Vec3{}) - cameras[c].centre_in_world());
        }
        for (std::size_t k = 0; k < shapes.size(); ++k) {
            const Projection& own = projections[k];
            apply_mask(seen, own.mask, out[k]->own[c]);
            std::vector<std::uint8_t>& shared = out[k]->shared[c];
            std::int64_t hidden = 0;
            for (std::size_t j = 0; j < shapes.size(); ++j) {
                const Projection& other = projections[j];
                if (j == k || !overlap(own.box, other.box)) continue;
                shared.resize(seen.sharp.size());
                const bool nearer = other.distance_m < own.distance_m;
                for (int y = other.box.y0; y < other.box.y1; ++y)
                    for (int x = other.box.x0; x < other.box.x1; ++x) {
                        const std::size_t at = static_cast<std::size_t>(y) * seen.width + x;
                        if (other.mask[at] && seen.sharp[at]) shared[at] = 255;
                        hidden += nearer && other.mask[at] && own.mask[at] && seen.sharp[at];
                    }
            }
            out[k]->hidden_fraction[c] =
                static_cast<float>(hidden) /
                static_cast<float>(std::max<std::int64_t>(1, out[k]->own[c].sharp_pixels));
        }
    });
}

}  // namespace kinevox
