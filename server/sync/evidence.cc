#include "server/sync/evidence.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <utility>

#include "common/median.h"

namespace kinevox::sync {
namespace {

constexpr double kFirstScatter_px = 2, kMinScatter_px = 0.5, kMaxScatter_px = 6;  // times pixel_px
constexpr double kBias_px = 0.7;            // standard deviation of calibration errors, times pixel_px
constexpr std::size_t kMaxForChance = 400;  // samples of a signal
constexpr std::size_t kMinValues = 10;      // of an informative signal
constexpr double kMinIndependent = 4;       // stretches, for a correlation
constexpr double kMaxCorrelation = 0.98;    // upper bound for two views
constexpr int kFactors = 16;                // multiplied before taking a logarithm: cannot overflow

// Log likelihood of a distance, Cauchy's without its constant: a wrong silhouette costs little.
double log_likelihood(double distance, double scatter) {
    const double ratio = distance / scatter;
    return -std::log1p(ratio * ratio);
}

std::vector<double> values_of(const Signal& signal) {
    std::vector<double> values;
    for (const double v : signal)
        if (!std::isnan(v)) values.push_back(v);
    if (values.size() <= kMaxForChance) return values;
    std::vector<double> some;
    for (std::size_t i = 0; i < kMaxForChance; ++i) some.push_back(values[i * values.size() / kMaxForChance]);
    return some;
}

// The signal between two images; NaN if either is missing.
double value_at(const Signal& signal, double position) {
    const double whole = std::floor(position), fraction = position - whole;
    if (whole < 0 || whole > static_cast<double>(signal.size() - 1))
        return std::numeric_limits<double>::quiet_NaN();
    const auto i = static_cast<std::size_t>(whole);
    if (fraction < 1e-9) return signal[i];
    return i + 1 < signal.size() ? signal[i] + fraction * (signal[i + 1] - signal[i])
                                 : std::numeric_limits<double>::quiet_NaN();
}

}  // namespace

PairEvidence::PairEvidence(PairSignals signals, const EvidenceOptions& options)
    : signals_(std::move(signals)),
      options_(options),
      independent_(std::max(1.0, options.independent_s * options.fps)) {
    std::erase_if(signals_.equal_px, [](const std::array<Signal, 2>& pair) {
        return values_of(pair[0]).size() < kMinValues || values_of(pair[1]).size() < kMinValues;
    });
    scatter_px_.assign(signals_.equal_px.size(), kFirstScatter_px * options_.pixel_px);
    const auto mask = [](const std::vector<std::array<Signal, 2>>& from,
                         std::vector<std::array<Masked, 2>>& to) {
        to.resize(from.size());
        for (std::size_t k = 0; k < from.size(); ++k)
            for (const int side : {0, 1})
                for (const double v : from[k][side]) {
                    to[k][side].value.push_back(std::isnan(v) ? 0 : v);
                    to[k][side].there.push_back(std::isnan(v) ? 0 : 1);
                }
    };
    mask(signals_.equal_px, equal_);
    mask(signals_.alike, alike_);
    measure_chance();
}

void PairEvidence::measure_chance() {
    chance_.clear();
    for (std::size_t k = 0; k < signals_.equal_px.size(); ++k) {
        const std::vector<double> x = values_of(signals_.equal_px[k][0]),
                                  y = values_of(signals_.equal_px[k][1]);
        double sum = 0;
        for (const double a : x)
            for (const double b : y) sum += log_likelihood(a - b, scatter_px_[k]);
        chance_.push_back(sum / static_cast<double>(x.size() * y.size()));
    }
}

double PairEvidence::alike_evidence(double n, double x, double y, double xx, double yy, double xy) const {
    if (n < kMinIndependent * independent_) return 0;
    const double both = (xx - x * x / n) * (yy - y * y / n);
    if (!(both > 0)) return 0;
    const double correlation =
        std::clamp((xy - x * y / n) / std::sqrt(both), -kMaxCorrelation, kMaxCorrelation);
    const double sign = correlation < 0 ? -1 : 1;
    return options_.alike_weight * sign * -0.5 * (n / independent_ - 1) *
           std::log1p(-correlation * correlation);
}

PairEvidence::Entry PairEvidence::whole(int lag) const {
    Entry out;
    // Images from .. to - 1 of the first camera overlap the second.
    const auto range = [lag](const std::array<Masked, 2>& pair) {
        const int from = std::max(0, lag);
        const int to =
            std::min(static_cast<int>(pair[0].value.size()), static_cast<int>(pair[1].value.size()) + lag);
        return std::pair{from, to};
    };
    for (std::size_t k = 0; k < equal_.size(); ++k) {
        const auto [from, to] = range(equal_[k]);
        const double *x = equal_[k][0].value.data(), *in_x = equal_[k][0].there.data();
        const double *y = equal_[k][1].value.data(), *in_y = equal_[k][1].there.data();
        const double inverse = 1 / scatter_px_[k];
        double logarithms = 0, count = 0;
        for (int i = from; i < to; i += kFactors) {
            double product = 1;
            for (int j = i; j < std::min(i + kFactors, to); ++j) {
                const double both = in_x[j] * in_y[j - lag], ratio = both * (x[j] - y[j - lag]) * inverse;
                product *= 1 + ratio * ratio;
                count += both;
            }
            logarithms += std::log(product);
        }
        out.evidence += (-logarithms - count * chance_[k]) / independent_;
        out.overlap = std::max(out.overlap, static_cast<int>(count));
    }
    for (const auto& pair : alike_) {
        const auto [from, to] = range(pair);
        const double *x = pair[0].value.data(), *in_x = pair[0].there.data();
        const double *y = pair[1].value.data(), *in_y = pair[1].there.data();
        double n = 0, sx = 0, sy = 0, sxx = 0, syy = 0, sxy = 0;
        for (int i = from; i < to; ++i) {
            const double a = x[i], in_a = in_x[i], b = y[i - lag], in_b = in_y[i - lag];
            n += in_a * in_b;
            sx += a * in_b, sy += b * in_a;
            sxx += a * a * in_b, syy += b * b * in_a;
            sxy += a * b;
        }
        out.evidence += alike_evidence(n, sx, sy, sxx, syy, sxy);
        out.overlap = std::max(out.overlap, static_cast<int>(n));
    }
    if (out.overlap < options_.min_overlap_s * options_.fps) out.evidence = std::min(out.evidence, 0.0);
    return out;
}

void PairEvidence::tabulate(int lowest, int highest) {
    int lengths[2] = {0, 0};
    for (const auto* signals : {&signals_.equal_px, &signals_.alike})
        for (const auto& pair : *signals)
            for (const int side : {0, 1})
                lengths[side] = std::max(lengths[side], static_cast<int>(pair[side].size()));
    lowest_ = std::max(lowest, 1 - lengths[1]);
    const int last = std::min(highest, lengths[0] - 1);
    table_.assign(std::max(0, last - lowest_ + 1), {});
    oneapi::tbb::parallel_for(0, static_cast<int>(table_.size()),
                              [this](int i) { table_[i] = whole(lowest_ + i); });
}

std::vector<double> PairEvidence::distances_px(std::size_t signal, double lag) const {
    std::vector<double> out;
    const auto& [x, y] = signals_.equal_px[signal];
    for (std::size_t i = 0; i < x.size(); ++i)
        if (const double d = x[i] - value_at(y, static_cast<double>(i) - lag); !std::isnan(d))
            out.push_back(d);
    return out;
}

double PairEvidence::between(double lag) const {
    double evidence = 0;
    for (std::size_t k = 0; k < signals_.equal_px.size(); ++k) {
        std::vector<double> distances = distances_px(k, lag);
        if (distances.empty()) continue;
        const double stretches = static_cast<double>(distances.size()) / independent_;
        // The median, shrunk by the prior of a small bias.
        const double prior = kBias_px * options_.pixel_px, scatter = scatter_px_[k];
        std::vector<double> sorted = distances;
        const double bias =
            median_of(sorted) * prior * prior / (prior * prior + 2 * scatter * scatter / stretches);
        double sum = 0;
        for (const double d : distances) sum += log_likelihood(d - bias, scatter) - chance_[k];
        evidence += sum / independent_ - 0.5 * bias * bias / (prior * prior);
    }
    for (const auto& [x, y] : signals_.alike) {
        double n = 0, sx = 0, sy = 0, sxx = 0, syy = 0, sxy = 0;
        for (std::size_t i = 0; i < x.size(); ++i) {
            const double a = x[i], b = value_at(y, static_cast<double>(i) - lag);
            if (std::isnan(a) || std::isnan(b)) continue;
            ++n, sx += a, sy += b, sxx += a * a, syy += b * b, sxy += a * b;
        }
        evidence += alike_evidence(n, sx, sy, sxx, syy, sxy);
    }
    return evidence;
}

void PairEvidence::fix_scatter(double lag) {
    for (std::size_t k = 0; k < signals_.equal_px.size(); ++k) {
        std::vector<double> distances = distances_px(k, lag);
        if (distances.size() < kMinValues) continue;
        for (double& d : distances) d = std::abs(d);
        scatter_px_[k] = std::clamp(median_of(distances), kMinScatter_px * options_.pixel_px,
                                    kMaxScatter_px * options_.pixel_px);
    }
    measure_chance();
}

std::optional<double> PairEvidence::residual_px(double lag) const {
    std::vector<double> all;
    for (std::size_t k = 0; k < signals_.equal_px.size(); ++k)
        for (const double d : distances_px(k, lag)) all.push_back(std::abs(d));
    if (all.size() < kMinValues) return std::nullopt;
    return median_of(all);
}

}  // namespace kinevox::sync
