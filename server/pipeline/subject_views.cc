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

// The projections are dilated by these fractions of the image height: a silhouette is up to a voxel and its
// own error wider than the volume that it carved.
constexpr int kOwn = 80, kOthers = 120;

struct Projection {
    std::vector<std::uint8_t> own, other;  // dilated for the subject itself, and as another one
    kernels::Rect own_box, other_box;
    double distance_m = 0;  // of the volume's centre from the camera
};

}  // namespace

void separate_subjects(const std::vector<Camera>& cameras, const std::vector<kernels::CameraModel>& models,
                       std::span<const kernels::Silhouettes> silhouettes,
                       std::span<const kernels::VoxelVolume* const> shapes,
                       std::span<SubjectViews* const> out) {
    for (SubjectViews* const views : out) {
        views->own.resize(cameras.size());
        views->others.assign(cameras.size(), {});
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
            p.own.resize(seen.sharp.size());
            p.other.resize(seen.sharp.size());
            kernels::project_volume(*shapes[k], models[c], still, std::max(1, seen.height / kOwn),
                                    p.own.data(), p.own_box);
            kernels::project_volume(*shapes[k], models[c], still, std::max(1, seen.height / kOthers),
                                    p.other.data(), p.other_box);
            p.distance_m = norm(centre_of(*shapes[k]).value_or(Vec3{}) - cameras[c].centre_in_world());
        }
        for (std::size_t k = 0; k < shapes.size(); ++k) {
            const Projection& own = projections[k];
            apply_mask(seen, own.own, out[k]->own[c]);
            std::vector<std::uint8_t>& others = out[k]->others[c];
            std::int64_t hidden = 0;
            for (std::size_t j = 0; j < shapes.size(); ++j) {
                const Projection& other = projections[j];
                if (j == k || !overlap(own.own_box, other.other_box)) continue;
                others.resize(seen.sharp.size());
                for (std::size_t n = 0; n < others.size(); ++n) {
                    others[n] |= other.other[n];
                    hidden +=
                        other.distance_m < own.distance_m && other.other[n] && own.own[n] && seen.sharp[n];
                }
            }
            out[k]->hidden_fraction[c] =
                static_cast<float>(hidden) /
                static_cast<float>(std::max<std::int64_t>(1, out[k]->own[c].sharp_pixels));
        }
    });
}

}  // namespace kinevox
