#include "server/pipeline/subject_views.h"

#include <algorithm>

#include "common/geometry.h"
#include "kernels/projection.h"
#include "server/pipeline/convert.h"
#include "server/pipeline/for_each_camera.h"
#include "server/pipeline/tracking/cone_box.h"
#include "server/pose/main_body.h"
#include "server/silhouettes/mask_box.h"

namespace kinevox {
namespace {

// The projections are dilated by this fraction of the image height: a silhouette is up to a voxel and its own
// error wider than the volume that it carved.
constexpr int kDilation = 100;
// Maximum foreground beside a projection that belongs to it, relative to that inside. More is clutter.
constexpr double kMaxBeside = 0.2;

// Of an image with `pixels`, nothing set.
void clear(std::size_t pixels, int width, ForegroundPart& part) {
    if (part.mask.size() == pixels) clear_box(part.mask, width, part.box);
    part.box = {};
}

// Adds the foreground inside a projection; returns how many of its pixels `own` has too.
std::int64_t add_foreground(const kernels::Silhouettes& seen, const std::vector<std::uint8_t>& projection,
                            const kernels::Rect& box, const std::vector<std::uint8_t>& own,
                            ForegroundPart& part) {
    part.mask.resize(seen.sharp.size(), 0);
    std::int64_t common = 0;
    for (int y = box.y0; y < box.y1; ++y) {
        const std::size_t row = static_cast<std::size_t>(y) * seen.width;
        int pixels = 0, in_both = 0;
        for (int x = box.x0; x < box.x1; ++x) {
            const std::uint8_t set = projection[row + x] & seen.sharp[row + x];
            part.mask[row + x] |= set;
            pixels += set != 0;
            in_both += (set & own[row + x]) != 0;
        }
        common += in_both;
        if (pixels == 0) continue;
        int x0 = box.x0, x1 = box.x1;
        while (!part.mask[row + x0]) ++x0;
        while (!part.mask[row + x1 - 1]) --x1;
        const kernels::Rect line{x0, y, x1, y + 1};
        part.box = part.box.empty() ? line : union_of(part.box, line);
    }
    return common;
}

constexpr int kNone = -1, kSeveral = -2;
// The shape whose projection sets one of these pixels; kSeveral if more do, `before` if none does.
int shape_at(std::size_t begin, std::size_t end, const auto& projections, int before) {
    for (std::size_t k = 0; k < projections.size(); ++k) {
        const auto& mask = projections[k].mask;
        if (std::any_of(mask.begin() + begin, mask.begin() + end, [](std::uint8_t set) { return set != 0; }))
            before = before == kNone || before == static_cast<int>(k) ? static_cast<int>(k) : kSeveral;
    }
    return before;
}

}  // namespace

void SubjectSeparator::extend_projections(const kernels::Silhouettes& seen, View& view) {
    view.outside = seen.sharp;
    std::vector<std::int64_t> inside(view.projections.size(), 0), beside(view.projections.size(), 0);
    for (std::size_t k = 0; k < view.projections.size(); ++k) {
        const Projection& p = view.projections[k];
        for (int y = p.box.y0; y < p.box.y1; ++y) {
            const std::size_t row = static_cast<std::size_t>(y) * seen.width;
            int pixels = 0;
            for (int x = p.box.x0; x < p.box.x1; ++x) {
                const bool set = p.mask[row + x] != 0;
                pixels += set && seen.sharp[row + x];
                view.outside[row + x] = set ? 0 : view.outside[row + x];
            }
            inside[k] += pixels;
        }
    }
    view.components.find(view.outside.data(), seen.width, seen.bounds, true, true);
    view.beside.assign(view.components.components.size(), kNone);
    for (const kernels::cpu::Run& run : view.components.runs) {
        int& shape = view.beside[run.component];
        const int x0 = std::max(run.x0 - 1, 0), x1 = std::min(run.x1 + 1, seen.width);
        for (int y = std::max(run.y - 1, 0); y <= std::min(run.y + 1, seen.height - 1); ++y) {
            const std::size_t row = static_cast<std::size_t>(y) * seen.width;
            shape = shape_at(row + x0, row + x1, view.projections, shape);
        }
    }
    for (std::size_t n = 0; n < view.beside.size(); ++n)
        if (view.beside[n] >= 0) beside[view.beside[n]] += view.components.components[n].area;
    for (const kernels::cpu::Run& run : view.components.runs) {
        const int k = view.beside[run.component];
        if (k < 0 || static_cast<double>(beside[k]) > kMaxBeside * static_cast<double>(inside[k])) continue;
        Projection& p = view.projections[k];
        std::fill_n(p.mask.begin() + static_cast<std::ptrdiff_t>(run.y) * seen.width + run.x0,
                    run.x1 - run.x0, 255);
        const kernels::Rect line{run.x0, run.y, run.x1, run.y + 1};
        p.box = p.box.empty() ? line : union_of(p.box, line);
    }
}

void SubjectSeparator::separate(const std::vector<Camera>& cameras,
                                const std::vector<kernels::CameraModel>& models,
                                std::span<const kernels::Silhouettes> silhouettes,
                                std::span<const kernels::VoxelVolume* const> shapes,
                                std::span<SubjectViews* const> out) {
    for (SubjectViews* const views : out) {
        if (!views) continue;
        views->own.resize(cameras.size());
        views->shared.resize(cameras.size());
        views->hidden_fraction.assign(cameras.size(), 0);
    }
    views_.resize(cameras.size());
    for_each_camera(cameras.size(), [&](std::size_t c) {
        const kernels::Silhouettes& seen = silhouettes[c];
        for (SubjectViews* const views : out) {
            if (!views) continue;
            clear(seen.sharp.size(), seen.width, views->shared[c]);
            if (seen.sharp.empty()) views->own[c] = {};
        }
        if (seen.sharp.empty()) return;
        std::vector<Projection>& projections = views_[c].projections;
        projections.resize(shapes.size());
        const float still[3] = {0, 0, 0};
        for (std::size_t k = 0; k < shapes.size(); ++k) {
            Projection& p = projections[k];
            p.mask.resize(seen.sharp.size());
            kernels::project_volume(*shapes[k], models[c], still, std::max(1, seen.height / kDilation),
                                    p.mask.data(), p.box);
            p.distance_m = norm(centre_of(*shapes[k]).value_or(Vec3{}) - cameras[c].centre_in_world());
        }
        extend_projections(seen, views_[c]);
        for (std::size_t k = 0; k < shapes.size(); ++k) {
            if (!out[k]) continue;
            const Projection& own = projections[k];
            apply_mask(seen, own.mask, own.box, out[k]->own[c]);
            std::int64_t hidden = 0;
            for (std::size_t j = 0; j < shapes.size(); ++j) {
                const Projection& other = projections[j];
                if (j == k || !overlap(own.box, other.box)) continue;
                const std::int64_t common =
                    add_foreground(seen, other.mask, other.box, own.mask, out[k]->shared[c]);
                if (other.distance_m < own.distance_m) hidden += common;
            }
            out[k]->hidden_fraction[c] =
                static_cast<float>(hidden) /
                static_cast<float>(std::max<std::int64_t>(1, out[k]->own[c].sharp_pixels));
        }
    });
}

}  // namespace kinevox
