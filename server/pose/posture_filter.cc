#include "server/pose/posture_filter.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <span>

#include "server/pose/foot_turn.h"

namespace kinevox {
namespace {

// Weight of a new value in a first-order low pass.
double share_of_new(double cutoff_hz, double seconds) {
    const double x = 2 * std::numbers::pi * cutoff_hz * seconds;
    return x / (1 + x);
}

struct Biquad {
    double b0, b1, b2, a1, a2;
};

// Two passes lower the cutoff; its frequency is raised so that together they have -3 dB there (Winter,
// section 2.2.4.4).
Biquad butterworth(double fps, double cutoff_hz) {
    const double corrected = cutoff_hz / std::pow(std::numbers::sqrt2 - 1, 0.25);
    const double k = std::tan(std::numbers::pi * corrected / fps);
    const double norm = 1 / (1 + std::numbers::sqrt2 * k + k * k);
    return {k * k * norm, 2 * k * k * norm, k * k * norm, 2 * (k * k - 1) * norm,
            (1 - std::numbers::sqrt2 * k + k * k) * norm};
}

// In place, initialised with the first value as steady state.
void run_filter(const Biquad& f, std::vector<double>& x) {
    double x1 = x.front(), x2 = x1, y1 = x1, y2 = x1;
    for (double& value : x) {
        const double y = f.b0 * value + f.b1 * x1 + f.b2 * x2 - f.a1 * y1 - f.a2 * y2;
        x2 = x1, x1 = value, y2 = y1, y1 = y;
        value = y;
    }
}

void run_both_ways(const Biquad& f, std::vector<double>& x) {
    // Mirrored about its end values, so that position and velocity are continuous.
    const std::size_t n = x.size(), pad = std::min<std::size_t>(n - 1, 30);
    std::vector<double> padded;
    padded.reserve(n + 2 * pad);
    for (std::size_t k = pad; k > 0; --k) padded.push_back(2 * x[0] - x[k]);
    padded.insert(padded.end(), x.begin(), x.end());
    for (std::size_t k = 1; k <= pad; ++k) padded.push_back(2 * x[n - 1] - x[n - 1 - k]);
    run_filter(f, padded);
    std::reverse(padded.begin(), padded.end());
    run_filter(f, padded);
    std::reverse(padded.begin(), padded.end());
    std::copy_n(padded.begin() + static_cast<std::ptrdiff_t>(pad), n, x.begin());
}

Mat3 orthonormal(const Mat3& m) {
    const Vec3 x = normalized({m(0, 0), m(1, 0), m(2, 0)});
    Vec3 y{m(0, 1), m(1, 1), m(2, 1)};
    y = normalized(y - dot(x, y) * x);
    const Vec3 z = cross(x, y);
    return {{x.x, y.x, z.x, x.y, y.y, z.y, x.z, y.z, z.z}};
}

void smooth_run(const Biquad& f, std::span<std::optional<BodyPosture>> run) {
    if (run.size() < 3) return;
    std::vector<double> x(run.size());
    double Vec3::*const axes[3] = {&Vec3::x, &Vec3::y, &Vec3::z};
    for (const auto axis : axes) {
        for (std::size_t n = 0; n < run.size(); ++n) x[n] = run[n]->root_in_world.*axis;
        run_both_ways(f, x);
        for (std::size_t n = 0; n < run.size(); ++n) run[n]->root_in_world.*axis = x[n];
    }
    for (int s = 0; s < kBodySegmentCount; ++s) {
        // The elements of a rotation matrix are continuous; neighbouring frames differ little, so that
        // re-orthonormalising the smoothed ones is a small correction.
        std::vector<Mat3> smoothed(run.size());
        for (int k = 0; k < 9; ++k) {
            for (std::size_t n = 0; n < run.size(); ++n) x[n] = run[n]->parent_from_segment[s].m[k];
            run_both_ways(f, x);
            for (std::size_t n = 0; n < run.size(); ++n) smoothed[n].m[k] = x[n];
        }
        for (std::size_t n = 0; n < run.size(); ++n)
            run[n]->parent_from_segment[s] = orthonormal(smoothed[n]);
    }
}

}  // namespace

std::string OneEuroOptions::check() const {
    if (!(min_cutoff_hz > 0) || !(rate_cutoff_hz > 0) || !(speed_factor_root >= 0) ||
        !(speed_factor_angle >= 0))
        return fmt::format(
            "One-Euro filter: cutoffs {} and {} Hz must be positive, speed factors {} and {} not negative",
            min_cutoff_hz, rate_cutoff_hz, speed_factor_root, speed_factor_angle);
    return {};
}

BodyPosture OneEuroPosture::filter(const BodyPosture& measured, std::int64_t time_ns) {
    const double seconds = 1e-9 * static_cast<double>(time_ns - last_time_ns_);
    last_time_ns_ = time_ns;
    if (!last_ || !(seconds > 0) || seconds > 1) {
        rate_ = {};
        last_measured_ = measured;
        return *(last_ = measured);
    }
    // The filter corrects the posture to which the motion so far leads: a steady motion has no lag.
    BodyStep expected;
    for (int k = 0; k < kBodyDofCount; ++k) expected[k] = seconds * rate_[k];
    const BodyPosture predicted = stepped(*last_, expected);
    const BodyStep ahead = step_between(predicted, measured), moved = step_between(*last_measured_, measured);
    const double rate_weight = share_of_new(options_.rate_cutoff_hz, seconds);
    BodyStep step;
    for (int k = 0; k < kBodyDofCount; ++k) {
        rate_[k] += rate_weight * (moved[k] / seconds - rate_[k]);
        const double factor = k < 3 ? options_.speed_factor_root : options_.speed_factor_angle;
        step[k] = share_of_new(options_.min_cutoff_hz + factor * std::abs(rate_[k]), seconds) * ahead[k];
    }
    last_measured_ = measured;
    last_ = stepped(predicted, step);
    for (const int foot : {kFootL, kFootR}) {
        const double turned = foot_turn(measured, foot) - foot_turn(*last_, foot);
        add_foot_turn(share_of_new(options_.min_cutoff_hz, seconds) * turned, foot, *last_);
    }
    return *last_;
}

double applied_cutoff_hz(double cutoff_hz, double fps) {
    constexpr double kMinSamplesPerPeriod = 3;
    return fps < kMinSamplesPerPeriod * cutoff_hz ? 0 : cutoff_hz;
}

void smooth_zero_phase(std::vector<std::optional<BodyPosture>>& postures, double fps, double cutoff_hz) {
    const Biquad f = butterworth(fps, cutoff_hz);
    for (std::size_t begin = 0; begin < postures.size();) {
        if (!postures[begin]) {
            ++begin;
            continue;
        }
        std::size_t end = begin;
        while (end < postures.size() && postures[end]) ++end;
        smooth_run(f, std::span(postures).subspan(begin, end - begin));
        begin = end;
    }
}

}  // namespace kinevox
