#include "server/sync/signals.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

#include "common/geometry.h"
#include "common/median.h"

namespace kinevox::sync {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
constexpr double kMovementSmoothing_s = 0.05;  // of positions, before differentiation
constexpr double kSlow_s = 0.5;                // slower components depend on the camera's position
constexpr double kTangentSmoothing_s = 0.03;
constexpr double kMinWeight = 0.3;  // of a Gaussian's weight that must lie on values

constexpr double kMinBaseline_m = 0.05;
constexpr double kMinOffAxis = 0.17;   // sine: closer to the baseline a plane is unreliable
constexpr double kMaxAngle_rad = 2.4;  // a silhouette that covers more has the other camera behind it

template <class Value>
Signal collect(const CameraMotion& motion, Value value) {
    Signal out(motion.shapes.size(), kNone);
    for (std::size_t i = 0; i < out.size(); ++i)
        if (motion.shapes[i].seen) out[i] = value(motion.shapes[i]);
    return out;
}

double finite_median(std::vector<double> values) {
    std::erase_if(values, [](double v) { return std::isnan(v); });
    return values.empty() ? kNone : median_of(values);
}

// Difference of the smoothed signal, at the later of two images, times `factor`.
Signal rises(const Signal& signal, double smoothing, double factor) {
    const Signal smooth = smoothed(signal, smoothing);
    Signal out(signal.size(), kNone);
    for (std::size_t i = 1; i < out.size(); ++i) out[i] = factor * (smooth[i] - smooth[i - 1]);
    return out;
}

Signal without_slow(Signal signal, double samples) {
    const Signal slow = smoothed(signal, samples);
    for (std::size_t i = 0; i < signal.size(); ++i) signal[i] -= slow[i];
    return signal;
}

Vec3 direction_in_world(const Camera& camera, Vec2 pixel) {
    return camera.ray_through(pixel).direction_in_world;
}

// Unit directions to a silhouette's hull; empty if there is none.
struct HullDirections {
    std::vector<Vec3> directions_in_world;
    const std::vector<bool>* at_border = nullptr;
};

std::vector<HullDirections> hull_directions(const CameraMotion& motion) {
    std::vector<HullDirections> out(motion.shapes.size());
    oneapi::tbb::parallel_for(std::size_t{0}, out.size(), [&](std::size_t i) {
        const SilhouetteShape& shape = motion.shapes[i];
        if (!shape.seen) return;
        for (const Vec2 point : shape.hull)
            out[i].directions_in_world.push_back(direction_in_world(motion.camera, point));
        out[i].at_border = &shape.hull_at_border;
    });
    return out;
}

Vec3 mean_direction(const std::vector<HullDirections>& seen) {
    Vec3 sum;
    for (const HullDirections& hull : seen)
        for (const Vec3 direction : hull.directions_in_world)
            sum += (1.0 / static_cast<double>(hull.directions_in_world.size())) * direction;
    return sum;
}

// Angles of the two tangent planes, radians about `axis` from `from`, and the median number of pixels per
// radian.
struct Touches {
    Signal angle[2];
    double pixels_per_radian = kNone;
};

Touches touches(const CameraMotion& motion, const std::vector<HullDirections>& seen, Vec3 axis, Vec3 from) {
    const Vec3 across = cross(axis, from);
    Touches out;
    for (Signal& angle : out.angle) angle.assign(seen.size(), kNone);
    std::vector<double> scales;
    for (std::size_t i = 0; i < seen.size(); ++i) {
        const auto& directions = seen[i].directions_in_world;
        if (directions.empty()) continue;
        double ends[2] = {10, -10};
        std::size_t at[2] = {0, 0};
        for (std::size_t j = 0; j < directions.size(); ++j) {
            const double angle = std::atan2(dot(directions[j], across), dot(directions[j], from));
            if (angle < ends[0]) ends[0] = angle, at[0] = j;
            if (angle > ends[1]) ends[1] = angle, at[1] = j;
        }
        if (ends[1] - ends[0] > kMaxAngle_rad) continue;
        for (const int k : {0, 1}) {
            const double off_axis = norm(cross(axis, directions[at[k]]));
            if ((*seen[i].at_border)[at[k]] || off_axis < kMinOffAxis) continue;
            out.angle[k][i] = ends[k];
            scales.push_back(motion.camera.fx * off_axis);
        }
    }
    out.pixels_per_radian = finite_median(std::move(scales));
    return out;
}

std::vector<std::array<Signal, 2>> touching_planes(const CameraMotion& a, const CameraMotion& b,
                                                   const std::vector<HullDirections>& in_a,
                                                   const std::vector<HullDirections>& in_b,
                                                   double smoothing) {
    const Vec3 base = b.camera.centre_in_world() - a.camera.centre_in_world();
    if (!(norm(base) > kMinBaseline_m)) return {};
    const Vec3 axis = normalized(base);
    // Towards the subject, so that no angle is near the end of its range.
    const Vec3 towards = mean_direction(in_a) + mean_direction(in_b);
    const Vec3 square = towards - dot(towards, axis) * axis;
    if (!(norm(square) > 0.05 * norm(towards))) return {};
    const Touches at_a = touches(a, in_a, axis, normalized(square)),
                  at_b = touches(b, in_b, axis, normalized(square));
    // Pixels per radian, from the rotation per pixel in either image.
    const double pixels = 1 / std::hypot(1 / at_a.pixels_per_radian, 1 / at_b.pixels_per_radian);
    if (!std::isfinite(pixels)) return {};
    std::vector<std::array<Signal, 2>> out;
    for (const int k : {0, 1}) {
        std::array<Signal, 2> pair = {smoothed(at_a.angle[k], smoothing), smoothed(at_b.angle[k], smoothing)};
        for (Signal& signal : pair)
            for (double& value : signal) value *= pixels;
        out.push_back(std::move(pair));
    }
    return out;
}

}  // namespace

Signal smoothed(const Signal& signal, double std_samples) {
    const int radius = static_cast<int>(std::ceil(3 * std_samples));
    std::vector<double> weights(2 * radius + 1);
    double all = 0;
    for (int k = -radius; k <= radius; ++k)
        all += weights[k + radius] = std::exp(-0.5 * k * k / (std_samples * std_samples));
    const int size = static_cast<int>(signal.size());
    Signal out(signal.size(), kNone);
    for (int i = 0; i < size; ++i) {
        if (std::isnan(signal[i])) continue;
        double sum = 0, weight = 0;
        for (int k = std::max(-radius, -i); k <= std::min(radius, size - 1 - i); ++k)
            if (!std::isnan(signal[i + k]))
                sum += weights[k + radius] * signal[i + k], weight += weights[k + radius];
        if (weight > kMinWeight * all) out[i] = sum / weight;
    }
    return out;
}

MovementSignals movement_signals(const CameraMotion& motion, double fps) {
    const double height =
        finite_median(collect(motion, [](const SilhouetteShape& s) { return s.bottom_px - s.top_px; }));
    const double per_height = -fps / height;  // y points down
    const double smoothing = std::max(1.0, kMovementSmoothing_s * fps), slow = kSlow_s * fps;
    MovementSignals out;
    const Signal top =
        collect(motion, [](const SilhouetteShape& s) { return s.truncated_top ? kNone : s.top_px; });
    const Signal centroid = collect(motion, [](const SilhouetteShape& s) { return s.centroid_y_px; });
    const Signal changed =
        collect(motion, [](const SilhouetteShape& s) { return s.changed_px2 / s.area_px2; });
    out.top = without_slow(rises(top, smoothing, per_height), slow);
    out.centroid = without_slow(rises(centroid, smoothing, per_height), slow);
    out.changed_fraction = smoothed(changed, smoothing);
    out.change = out.changed_fraction;
    for (double& value : out.change) value = std::log(value + 1e-3);
    out.change = without_slow(std::move(out.change), slow);
    for (double& value : out.changed_fraction) value *= fps;
    out.hardly_moves = finite_median(changed);
    return out;
}

std::vector<PairSignals> pair_signals(const std::vector<CameraMotion>& cameras, double fps,
                                      const SignalOptions& options) {
    std::vector<MovementSignals> movements(cameras.size());
    std::vector<std::vector<HullDirections>> seen(cameras.size());
    oneapi::tbb::parallel_for(std::size_t{0}, cameras.size(), [&](std::size_t c) {
        movements[c] = movement_signals(cameras[c], fps);
        if (options.use_extrinsics) seen[c] = hull_directions(cameras[c]);
    });
    std::vector<PairSignals> out;
    for (std::size_t a = 0; a < cameras.size(); ++a)
        for (std::size_t b = a + 1; b < cameras.size(); ++b) {
            PairSignals& pair = out.emplace_back();
            pair.first = a, pair.second = b;
            pair.alike = {{movements[a].top, movements[b].top},
                          {movements[a].centroid, movements[b].centroid},
                          {movements[a].change, movements[b].change}};
        }
    if (!options.use_extrinsics) return out;
    const double smoothing = std::max(1.0, kTangentSmoothing_s * fps);
    oneapi::tbb::parallel_for(std::size_t{0}, out.size(), [&](std::size_t p) {
        const std::size_t a = out[p].first, b = out[p].second;
        out[p].equal_px = touching_planes(cameras[a], cameras[b], seen[a], seen[b], smoothing);
    });
    return out;
}

}  // namespace kinevox::sync
