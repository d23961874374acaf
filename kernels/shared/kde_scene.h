// What the cameras of a frame set look up of each other: which light a floor point has, and whether the
// subject can be on a pixel's ray.
#pragma once

#include <cstddef>
#include <cstdint>

#include "kernels/shared/camera.h"
#include "kernels/shared/device.h"
#include "kernels/shared/kde_density.h"
#include "kernels/types.h"

namespace kinevox::kernels::kde {

inline constexpr int kMaxFloorViews = 4;  // other cameras that are asked for a floor point
inline constexpr int kFloorGrid_px = 8;   // spacing of the tabulated directions of a camera's pixels
inline constexpr float kMaxFloorDistance_m = 15;
inline constexpr float kDoubtfulEvidence = 3;  // nats; above it a pixel is the subject without a second look

// A camera's image and background, for looking up the light of single pixels; pointers in the memory of the
// segmenter's device.
struct SceneView {
    Projector camera;
    const std::uint8_t* image = nullptr;      // interleaved channels
    std::ptrdiff_t image_stride = 0;          // bytes
    const std::uint8_t* reference = nullptr;  // [row][cell][channel][64]
    const std::uint8_t* scale = nullptr;      // [row][cell][channel][64]
    int inverse_gain[3] = {0, 0, 0};          // 16384 / gain
    int channels = 3, cells_per_row = 0;
    const std::int8_t* votes = nullptr;  // [row][column] of blocks, see pixel_vote()
    int vote_columns = 0;
    // Around the subject, with a margin: left, right, top, bottom at depth 1 in the camera frame. Unless
    // `sees`, nothing here is plainly the subject.
    float bounds[4] = {0, 0, 0, 0};
    bool sees = false;
};

// A camera's vote on a block of its image, from the pixels' own evidence: 1 for each pixel that is plainly
// the subject, -1 for each that is plainly background, 0 for the doubtful ones.
inline constexpr int kVoteBlock_px = 4;
inline constexpr int kMaxVote = kVoteBlock_px * kVoteBlock_px;
inline constexpr int kSubjectVote = kMaxVote / 2;    // of a block that lies in the subject
inline constexpr int kMinJudgedVote = 4 - kMaxVote;  // fewer doubtful pixels than four are noise
KINEVOX_HD inline int pixel_vote(int density, float evidence) {
    return evidence >= kDoubtfulEvidence ? 1 : density >= kSureDensity ? -1 : 0;
}

// Directions of a camera's pixels, tabulated every kFloorGrid_px: x and y at depth 1 in the camera frame.
struct FloorGrid {
    const float* directions = nullptr;
    int columns = 0;
    float centre[3] = {0, 0, 0};  // of the camera, world, m
};

// x and y at depth 1 in the camera frame; NaN where the distortion model cannot be inverted.
KINEVOX_HD inline void direction_of(const FloorGrid& grid, float u, float v, float& dx, float& dy) {
    const float gu = u * (1.0f / kFloorGrid_px), gv = v * (1.0f / kFloorGrid_px);
    const int iu = static_cast<int>(gu), iv = static_cast<int>(gv);
    const float a = gu - static_cast<float>(iu), b = gv - static_cast<float>(iv);
    const float* upper = grid.directions + 2 * (static_cast<std::ptrdiff_t>(iv) * grid.columns + iu);
    const float* lower = upper + 2 * grid.columns;
    dx = (1 - b) * ((1 - a) * upper[0] + a * upper[2]) + b * ((1 - a) * lower[0] + a * lower[2]);
    dy = (1 - b) * ((1 - a) * upper[1] + a * upper[3]) + b * ((1 - a) * lower[1] + a * lower[3]);
}

// The floor point (z = 0 of the world frame) behind a pixel; false where there is none within
// kMaxFloorDistance_m.
KINEVOX_HD inline bool floor_point(const FloorGrid& grid, const Projector& camera, float u, float v, float& x,
                                   float& y) {
    float dx, dy;
    direction_of(grid, u, v, dx, dy);
    const float* r = camera.r;  // its transpose turns the direction into the world
    const float down = -(r[2] * dx + r[5] * dy + r[8]);
    if (!(grid.centre[2] > 0) || !(down * kMaxFloorDistance_m > grid.centre[2])) return false;
    const float t = grid.centre[2] / down;
    x = grid.centre[0] + t * (r[0] * dx + r[3] * dy + r[6]);
    y = grid.centre[1] + t * (r[1] * dx + r[4] * dy + r[7]);
    return true;
}

// See SceneView::bounds: around `subject` (px) with a margin for what is not found yet, from a grid of
// directions of `columns` x `rows`; none at sides where the image, `width` x `height`, cuts the subject.
KINEVOX_HD inline void bounds_around(const Rect& subject, int width, int height, const float* directions,
                                     int columns, int rows, float bounds[4]) {
    constexpr float kMargin = 0.3f;  // of the subject's longer side
    constexpr float kBeyond = 1e3f;
    const int subject_width = subject.x1 - subject.x0, subject_height = subject.y1 - subject.y0;
    const int longer = subject_width > subject_height ? subject_width : subject_height;
    const int margin = kFloorGrid_px + static_cast<int>(kMargin * static_cast<float>(longer));
    const int x[3] = {subject.x0 - margin, (subject.x0 - margin + subject.x1 + margin) / 2,
                      subject.x1 + margin + kFloorGrid_px - 1};
    const int y[3] = {subject.y0 - margin, (subject.y0 - margin + subject.y1 + margin) / 2,
                      subject.y1 + margin + kFloorGrid_px - 1};
    bounds[0] = bounds[2] = kBeyond;
    bounds[1] = bounds[3] = -kBeyond;
    bool known = true;
    for (int i = 0; i < 9; ++i) {
        int column = x[i % 3] / kFloorGrid_px, row = y[i / 3] / kFloorGrid_px;
        column = column < 0 ? 0 : column < columns ? column : columns - 1;
        row = row < 0 ? 0 : row < rows ? row : rows - 1;
        const float* xy = directions + 2 * (static_cast<std::size_t>(row) * columns + column);
        known = known && xy[0] == xy[0];
        bounds[0] = xy[0] < bounds[0] ? xy[0] : bounds[0];
        bounds[1] = xy[0] > bounds[1] ? xy[0] : bounds[1];
        bounds[2] = xy[1] < bounds[2] ? xy[1] : bounds[2];
        bounds[3] = xy[1] > bounds[3] ? xy[1] : bounds[3];
    }
    if (!known || x[0] <= 0) bounds[0] = -kBeyond;
    if (!known || subject.x1 + margin >= width) bounds[1] = kBeyond;
    if (!known || y[0] <= 0) bounds[2] = -kBeyond;
    if (!known || subject.y1 + margin >= height) bounds[3] = kBeyond;
}

// Where the subject can be along a pixel's ray, by the votes of the other cameras.
inline constexpr int kSupportBlock_px = 8;           // pixels that share a ray, in rows and columns
inline constexpr int kSupportSamples = 16;           // along it
inline constexpr float kMinSupportHeight_m = 0.03f;  // on the floor, shadows look alike from everywhere
inline constexpr float kMinSupport = -0.25f;         // below it a doubtful pixel is background if not lighter
inline constexpr float kNoSupport = -2;              // nowhere
inline constexpr float kUnknownSupport = 2;          // no other camera sees the subject
inline constexpr float kMaxKnownSupport = 1.5f;      // above every other

struct SupportRay {
    float origin[3], direction[3];  // world; the direction has depth 1 in its camera
    float near = 0, far = 0;        // depths, m
    KINEVOX_HD void keep(float at_origin, float per_depth) {  // where at_origin + depth * per_depth >= 0
        const float root = -at_origin / per_depth;
        if (per_depth > 0) {
            near = root > near ? root : near;
        } else if (per_depth < 0) {
            far = root < far ? root : far;
        } else if (at_origin < 0) {
            far = near;
        }
    }
};

KINEVOX_HD inline bool support_ray(const FloorGrid& grid, const Projector& camera, float u, float v,
                                   SupportRay& ray) {
    constexpr float kMinDepth_m = 0.3f;
    float dx, dy;
    direction_of(grid, u, v, dx, dy);
    const float* r = camera.r;
    for (int i = 0; i < 3; ++i) {
        ray.origin[i] = grid.centre[i];
        ray.direction[i] = r[i] * dx + r[3 + i] * dy + r[6 + i];
    }
    ray.near = kMinDepth_m;
    ray.far = kMaxFloorDistance_m;
    ray.keep(ray.origin[2] - kMinSupportHeight_m, ray.direction[2]);
    return dx == dx && dy == dy;
}

// Confines the ray to what the view's bounds hold.
KINEVOX_HD inline void confine(const SceneView& view, SupportRay& ray) {
    const Projector& c = view.camera;
    const CameraPoint a = to_camera(c, ray.origin[0], ray.origin[1], ray.origin[2]);
    const float* d = ray.direction;
    const float bx = c.r[0] * d[0] + c.r[1] * d[1] + c.r[2] * d[2],
                by = c.r[3] * d[0] + c.r[4] * d[1] + c.r[5] * d[2],
                bz = c.r[6] * d[0] + c.r[7] * d[1] + c.r[8] * d[2];
    ray.keep(a.z - kNearest_m, bz);
    ray.keep(a.x - view.bounds[0] * a.z, bx - view.bounds[0] * bz);
    ray.keep(view.bounds[1] * a.z - a.x, view.bounds[1] * bz - bx);
    ray.keep(a.y - view.bounds[2] * a.z, by - view.bounds[2] * bz);
    ray.keep(view.bounds[3] * a.z - a.y, view.bounds[3] * bz - by);
}

// What is left of a ray inside the bounds of all views that see the subject. False where none of them does.
template <class View>
KINEVOX_HD inline bool confine_to_views(SupportRay& ray, int count, const View& view) {
    bool seen = false;
    for (int n = 0; n < count; ++n)
        if (view(n).sees) {
            confine(view(n), ray);
            seen = true;
        }
    return seen;
}

// The votes on the ray's sample i, or less than -kMaxVote * count where too many cameras are against it or
// where it cannot exceed `best`.
template <class View>
KINEVOX_HD inline int votes_on_sample(const SupportRay& ray, int i, int count, int best, const View& view) {
    // One camera of two or three may take the subject for background, two of five.
    const int max_against = (count + 1) / 3, rejected = -kMaxVote * count - 1;
    const float step = (ray.far - ray.near) * (1.0f / kSupportSamples);
    const float t = ray.near + (static_cast<float>(i) + 0.5f) * step;
    const float x = ray.origin[0] + t * ray.direction[0], y = ray.origin[1] + t * ray.direction[1],
                z = ray.origin[2] + t * ray.direction[2];
    int sum = 0, against = 0;
    for (int n = 0; n < count; ++n) {
        if (sum + kMaxVote * (count - n) <= best) return rejected;
        const SceneView& other = view(n);
        float u, v;
        if (!to_pixel(other.camera, to_camera(other.camera, x, y, z), u, v)) continue;
        const int cu = to_index(u), cv = to_index(v);
        if (cu < 0 || cv < 0 || cu >= other.camera.width || cv >= other.camera.height) continue;
        const int vote = other.votes[cv / kVoteBlock_px * other.vote_columns + cu / kVoteBlock_px];
        sum += vote;
        against += vote <= -kMaxVote + 1;
        if (against > max_against) return rejected;
    }
    return sum;
}

// Of the highest votes on the samples of a ray, as support_of().
KINEVOX_HD inline float support_of_votes(int best, int count) {
    if (best < -kMaxVote * count) return kNoSupport;
    return static_cast<float>(best) / static_cast<float>(kMaxVote * count);
}

// The highest mean vote of a point on the ray, -1..1; kNoSupport where too many cameras see plain background
// behind every one. view(n): the SceneView of the other camera n.
template <class View>
KINEVOX_HD inline float support_of(SupportRay ray, int count, const View& view) {
    if (!confine_to_views(ray, count, view)) return kUnknownSupport;
    if (!(ray.near < ray.far)) return kNoSupport;
    int best = -kMaxVote * count - 1;
    for (int i = 0; i < kSupportSamples; ++i) {
        const int sum = votes_on_sample(ray, i, count, best, view);
        if (sum > best) best = sum;
    }
    return support_of_votes(best, count);
}

}  // namespace kinevox::kernels::kde
