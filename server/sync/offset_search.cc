#include "server/sync/offset_search.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace kinevox::sync {
namespace {

constexpr std::size_t kMaxForAllWays = 8;  // cameras
constexpr int kMaxRounds = 20;
constexpr double kSearchRadius_frames = 1.5, kStep_frames = 0.25;  // around a pair's peak
constexpr double kOutlier_frames = 0.5;  // residual at which a pair has half its weight
constexpr double kMinCurvature = 1e-3;   // nats per frame squared

struct Peak {
    int lag = 0;
    double evidence = 0;
};

Peak highest_peak(const PairEvidence& pair, int max_lag) {
    Peak peak;
    for (int lag = std::max(pair.lowest(), -max_lag); lag <= std::min(pair.highest(), max_lag); ++lag)
        if (pair.at(lag) > peak.evidence) peak = {lag, pair.at(lag)};
    return peak;
}

double total(const std::vector<PairEvidence>& pairs, const std::vector<int>& offsets) {
    double sum = 0;
    for (const PairEvidence& pair : pairs) sum += pair.at(offsets[pair.second()] - offsets[pair.first()]);
    return sum;
}

// Joins cameras by the pairs' peaks in the given order; calls `joined` for each pair that joins two groups.
template <class Joined>
void join(const std::vector<PairEvidence>& pairs, const std::vector<std::size_t>& order, std::size_t cameras,
          Joined joined) {
    std::vector<std::size_t> group(cameras);
    std::iota(group.begin(), group.end(), std::size_t{0});
    for (const std::size_t p : order) {
        const std::size_t from = group[pairs[p].first()], to = group[pairs[p].second()];
        if (from == to) continue;
        joined(p, group);
        for (std::size_t& g : group)
            if (g == to) g = from;
    }
}

bool within(const std::vector<int>& offsets, int max_lag) {
    const auto [low, high] = std::minmax_element(offsets.begin(), offsets.end());
    return *high - *low <= max_lag;
}

// Moves one camera at a time to its best offset, until none moves.
void optimise_one_by_one(const std::vector<PairEvidence>& pairs, int max_lag, std::vector<int>& offsets) {
    for (int round = 0; round < kMaxRounds; ++round) {
        bool moved = false;
        for (std::size_t c = 0; c < offsets.size(); ++c) {
            int lowest = std::numeric_limits<int>::max(), highest = std::numeric_limits<int>::min();
            for (std::size_t other = 0; other < offsets.size(); ++other)
                if (other != c)
                    lowest = std::min(lowest, offsets[other]), highest = std::max(highest, offsets[other]);
            double best = -std::numeric_limits<double>::infinity();
            int best_at = offsets[c];
            for (int at = highest - max_lag; at <= lowest + max_lag; ++at) {
                double sum = 0;
                for (const PairEvidence& pair : pairs)
                    if (pair.first() == c)
                        sum += pair.at(offsets[pair.second()] - at);
                    else if (pair.second() == c)
                        sum += pair.at(at - offsets[pair.first()]);
                if (sum > best) best = sum, best_at = at;
            }
            moved = moved || best_at != offsets[c];
            offsets[c] = best_at;
        }
        if (!moved) return;
    }
}

// Peak of a parabola through the evidence around `lag`, and its curvature.
struct Top {
    double lag = std::numeric_limits<double>::quiet_NaN();
    double curvature = 0;
};

Top top_near(const PairEvidence& pair, double lag) {
    const int count = static_cast<int>(std::lround(2 * kSearchRadius_frames / kStep_frames)) + 1;
    Eigen::MatrixXd powers(count, 3);
    Eigen::VectorXd values(count);
    for (int i = 0; i < count; ++i) {
        const double x = -kSearchRadius_frames + i * kStep_frames;
        powers.row(i) << 1, x, x * x;
        values[i] = pair.between(lag + x);
    }
    const Eigen::Vector3d fit = powers.colPivHouseholderQr().solve(values);
    if (!(fit[2] < -kMinCurvature)) return {};
    const double top = -fit[1] / (2 * fit[2]);
    if (std::abs(top) > kSearchRadius_frames) return {};
    return {lag + top, -2 * fit[2]};
}

}  // namespace

std::vector<int> whole_offsets(const std::vector<PairEvidence>& pairs, std::size_t cameras, int max_lag) {
    std::vector<Peak> peaks;
    for (const PairEvidence& pair : pairs) peaks.push_back(highest_peak(pair, max_lag));
    std::vector<int> best(cameras, 0);
    double most = -std::numeric_limits<double>::infinity();
    // The strongest tree, and per camera the tree that joins it to all others first.
    for (std::size_t start = 0; start <= cameras; ++start) {
        std::vector<std::size_t> order(pairs.size());
        std::iota(order.begin(), order.end(), std::size_t{0});
        const auto has_start = [&](std::size_t p) {
            return pairs[p].first() == start || pairs[p].second() == start;
        };
        std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) {
            if (has_start(a) != has_start(b)) return has_start(a);
            return peaks[a].evidence > peaks[b].evidence;
        });
        std::vector<int> offsets(cameras, 0);
        join(pairs, order, cameras, [&](std::size_t p, const std::vector<std::size_t>& group) {
            const std::size_t to = group[pairs[p].second()];
            const int shift = offsets[pairs[p].first()] + peaks[p].lag - offsets[pairs[p].second()];
            for (std::size_t c = 0; c < cameras; ++c)
                if (group[c] == to) offsets[c] += shift;
        });
        if (!within(offsets, max_lag)) std::fill(offsets.begin(), offsets.end(), 0);
        optimise_one_by_one(pairs, max_lag, offsets);
        if (const double sum = total(pairs, offsets); sum > most) most = sum, best = offsets;
    }
    const int first = best.empty() ? 0 : best[0];
    for (int& offset : best) offset -= first;
    return best;
}

std::vector<Group> bipartitions(const std::vector<PairEvidence>& pairs, std::size_t cameras,
                                const std::vector<int>& offsets) {
    std::vector<Group> out;
    const auto add = [&](Group group) {
        if (2 * static_cast<std::size_t>(std::count(group.begin(), group.end(), true)) > cameras)
            group.flip();
        if (std::find(out.begin(), out.end(), group) == out.end()) out.push_back(std::move(group));
    };
    if (cameras <= kMaxForAllWays) {
        for (std::size_t bits = 1; bits < (std::size_t{1} << (cameras - 1)); ++bits) {
            Group group(cameras, false);
            for (std::size_t c = 0; c + 1 < cameras; ++c) group[c] = (bits >> c) & 1;
            add(std::move(group));
        }
        return out;
    }
    for (std::size_t c = 0; c < cameras; ++c) {
        Group group(cameras, false);
        group[c] = true;
        add(std::move(group));
    }
    std::vector<std::size_t> order(pairs.size());
    std::iota(order.begin(), order.end(), std::size_t{0});
    const auto evidence = [&](std::size_t p) {
        return pairs[p].at(offsets[pairs[p].second()] - offsets[pairs[p].first()]);
    };
    std::ranges::stable_sort(order, [&](std::size_t a, std::size_t b) { return evidence(a) > evidence(b); });
    join(pairs, order, cameras, [&](std::size_t p, const std::vector<std::size_t>& group) {
        Group side(cameras, false);
        for (std::size_t c = 0; c < cameras; ++c) side[c] = group[c] == group[pairs[p].second()];
        add(std::move(side));
    });
    return out;
}

GroupCurve group_curve(const std::vector<PairEvidence>& pairs, const Group& group,
                       const std::vector<int>& offsets, int max_shift) {
    GroupCurve out{std::vector<double>(2 * max_shift + 1, 0), std::vector<int>(2 * max_shift + 1, 0)};
    for (const PairEvidence& pair : pairs) {
        if (group[pair.first()] == group[pair.second()]) continue;
        const int lag = offsets[pair.second()] - offsets[pair.first()], sign = group[pair.second()] ? 1 : -1;
        for (int shift = -max_shift; shift <= max_shift; ++shift) {
            out.evidence[shift + max_shift] += pair.at(lag + sign * shift);
            out.overlap[shift + max_shift] += pair.overlap(lag + sign * shift);
        }
    }
    return out;
}

FineOffsets fine_offsets(const std::vector<PairEvidence>& pairs, std::size_t cameras,
                         const std::vector<int>& whole) {
    const auto count = static_cast<Eigen::Index>(cameras);
    FineOffsets out;
    out.frames.assign(whole.begin(), whole.end());
    std::vector<Top> tops;
    Eigen::MatrixXd spread = Eigen::MatrixXd::Zero(count, count);
    for (int round = 0; round < 2; ++round) {  // the second one around the first one's result
        tops.clear();
        for (const PairEvidence& pair : pairs)
            tops.push_back(top_near(pair, out.frames[pair.second()] - out.frames[pair.first()]));
        std::vector<double> weight(pairs.size(), 1);
        double misfit = 0;
        int used = 0;
        for (int again = 0; again < 10; ++again) {
            // The offsets' mean is undetermined; it is set to 0.
            Eigen::MatrixXd square = Eigen::MatrixXd::Constant(count, count, 1);
            Eigen::VectorXd right = Eigen::VectorXd::Zero(count);
            for (std::size_t p = 0; p < pairs.size(); ++p) {
                if (std::isnan(tops[p].lag)) continue;
                const auto a = static_cast<Eigen::Index>(pairs[p].first()),
                           b = static_cast<Eigen::Index>(pairs[p].second());
                const double w = weight[p] * tops[p].curvature;
                square(a, a) += w, square(b, b) += w, square(a, b) -= w, square(b, a) -= w;
                right[b] += w * tops[p].lag, right[a] -= w * tops[p].lag;
            }
            const Eigen::FullPivLU<Eigen::MatrixXd> solver(square);
            if (!solver.isInvertible()) break;  // a camera without a peak keeps its whole offset
            const Eigen::VectorXd solved = solver.solve(right);
            for (Eigen::Index c = 0; c < count; ++c) out.frames[c] = solved[c];
            spread = solver.inverse();
            misfit = 0, used = 0;
            for (std::size_t p = 0; p < pairs.size(); ++p) {
                if (std::isnan(tops[p].lag)) continue;
                const double apart = tops[p].lag - (solved[static_cast<Eigen::Index>(pairs[p].second())] -
                                                    solved[static_cast<Eigen::Index>(pairs[p].first())]);
                weight[p] = 1 / (1 + std::pow(apart / kOutlier_frames, 2));
                misfit += weight[p] * tops[p].curvature * apart * apart, ++used;
            }
        }
        const int spare = used - static_cast<int>(cameras) + 1;
        const double excess = spare > 0 ? std::max(1.0, misfit / spare) : 1;
        out.std_frames.clear();
        for (Eigen::Index c = 0; c < count; ++c)
            out.std_frames.push_back(std::sqrt(
                std::max(0.0, excess * (spread(c, c) - 1.0 / static_cast<double>(cameras * cameras)))));
        out.pairs.clear();
        for (std::size_t p = 0; p < pairs.size(); ++p) {
            const double lag = out.frames[pairs[p].second()] - out.frames[pairs[p].first()];
            const bool peaked = !std::isnan(tops[p].lag);
            out.pairs.push_back({pairs[p].first(), pairs[p].second(), tops[p].lag,
                                 peaked ? 1 / std::sqrt(tops[p].curvature) : 0,
                                 peaked ? tops[p].lag - lag : 0, peaked ? weight[p] : 0,
                                 pairs[p].between(lag), pairs[p].residual_px(lag)});
        }
    }
    return out;
}

}  // namespace kinevox::sync
