#include "server/pose/pose_path.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string_view>

#include "common/body_pose.h"
#include "server/pose/pose_fitter.h"

namespace kinevox {
namespace {

// Of a candidate's joint, and of accelerations: trunk and head, knees and elbows, the ends of the limbs.
constexpr double kJointStd_m = 0.02;
constexpr double kTrunkAcceleration = 15, kMiddleAcceleration = 30, kEndAcceleration = 50;  // m/s^2
constexpr double kSpeed = 4;          // m/s, std of the speed at the start of a path
constexpr double kRobust = 6;         // standard deviations beyond which an acceleration hardly counts
constexpr double kJointWeight = 0.5;  // the joints' accelerations are correlated
// Of the direction from shoulder to shoulder: a body without visible legs or in a symmetric posture fits its
// silhouettes from behind as well, but people do not turn around between two frame sets.
constexpr double kFacingStd_rad = 0.08, kFacingAcceleration = 40;  // rad/s^2
constexpr double kFacingWeight = 4;
// The misfit of a body to its silhouettes is alike in frame sets closer than this: they count as one.
constexpr double kCorrelated_s = 0.12;
// Cost per unit of log probability: the rays of a silhouette are not independent.
constexpr double kTemperature = 4;

using Costs = std::vector<double>;

std::array<double, kJointNames.size()> accelerations() {
    std::array<double, kJointNames.size()> of{};
    for (std::size_t j = 0; j < of.size(); ++j) {
        const std::string_view name = kJointNames[j];
        const auto is = [&](std::string_view part) { return name.starts_with(part); };
        of[j] = is("knee") || is("elbow")                               ? kMiddleAcceleration
                : is("wrist") || is("hand") || is("ankle") || is("toe") ? kEndAcceleration
                                                                        : kTrunkAcceleration;
    }
    return of;
}

double robust(double squared) {
    return 0.5 * squared / (1 + squared / (kRobust * kRobust));
}

Vec3 facing(const PathCandidate& c) {
    constexpr std::size_t kLeft = *joint_index("shoulder_l"), kRight = *joint_index("shoulder_r");
    return normalized(c.joints_in_world[kLeft] - c.joints_in_world[kRight]);
}

bool has_exchanged_ankles(const JointPositions& a, const JointPositions& b) {
    constexpr std::size_t kLeft = *joint_index("ankle_l"), kRight = *joint_index("ankle_r");
    constexpr double kMinApart_m = 0.2;
    const auto is_nearer_to_other = [&](std::size_t joint, std::size_t other) {
        return norm(b[joint] - a[other]) < 0.5 * norm(b[joint] - a[joint]);
    };
    return norm(a[kLeft] - a[kRight]) > kMinApart_m && is_nearer_to_other(kLeft, kRight) &&
           is_nearer_to_other(kRight, kLeft);
}

class Run {
  public:
    explicit Run(std::span<const PathFrame> frames) : frames_(frames), acceleration_(accelerations()) {
        if (frames.size() > 1) {
            const double interval = (frames.back().time_s - frames.front().time_s) / (frames.size() - 1.0);
            share_ = std::min(1.0, interval / kCorrelated_s);
        }
        link();
    }
    void choose(std::span<PathChoice> out) const {
        cheapest(out);
        weigh(out);
    }

  private:
    int count(std::size_t n) const { return static_cast<int>(frames_[n].candidates.size()); }
    const PathCandidate& at(std::size_t n, int k) const { return frames_[n].candidates[k]; }
    double cost(std::size_t n, int k) const { return share_ * at(n, k).total(); }

    // Costs of the motion: links_[n] of pairs for n = 1, of triples (i, j, k) ending in k at n otherwise.
    void link() {
        links_.resize(frames_.size());
        if (frames_.size() < 2) return;
        const double first = frames_[1].time_s - frames_[0].time_s;
        for (int i = 0; i < count(0); ++i)
            for (int j = 0; j < count(1); ++j) links_[1].push_back(moved(at(0, i), at(1, j), first));
        for (std::size_t n = 2; n < frames_.size(); ++n) {
            const double before = frames_[n - 1].time_s - frames_[n - 2].time_s,
                         now = frames_[n].time_s - frames_[n - 1].time_s;
            for (int i = 0; i < count(n - 2); ++i)
                for (int j = 0; j < count(n - 1); ++j)
                    for (int k = 0; k < count(n); ++k)
                        links_[n].push_back(accelerated(at(n - 2, i), at(n - 1, j), at(n, k), before, now));
        }
    }
    static double moved(const PathCandidate& a, const PathCandidate& b, double seconds) {
        const double std = 2 * kJointStd_m + kSpeed * seconds;
        double sum = 0;
        for (std::size_t j = 0; j < a.joints_in_world.size(); ++j) {
            const Vec3 d = b.joints_in_world[j] - a.joints_in_world[j];
            sum += kJointWeight * robust(dot(d, d) / (std * std));
        }
        return sum;
    }
    double accelerated(const PathCandidate& a, const PathCandidate& b, const PathCandidate& c, double before,
                       double now) const {
        const double ratio = now / before, span = 0.5 * now * (before + now);
        // Of c - b - ratio (b - a), each with its own error.
        const double errors = std::sqrt(1 + (1 + ratio) * (1 + ratio) + ratio * ratio);
        const double noise = kJointStd_m * errors;
        const Vec3 turn = facing(c) - facing(b) - ratio * (facing(b) - facing(a));
        const double turn_std = std::hypot(kFacingStd_rad * errors, kFacingAcceleration * span);
        double sum = kFacingWeight * robust(dot(turn, turn) / (turn_std * turn_std));
        for (std::size_t j = 0; j < a.joints_in_world.size(); ++j) {
            const Vec3 d = c.joints_in_world[j] - b.joints_in_world[j] -
                           ratio * (b.joints_in_world[j] - a.joints_in_world[j]);
            const double std = std::hypot(noise, acceleration_[j] * span);
            sum += kJointWeight * robust(dot(d, d) / (std * std));
        }
        return sum;
    }
    double triple(std::size_t n, int i, int j, int k) const {
        return links_[n][(static_cast<std::size_t>(i) * count(n - 1) + j) * count(n) + k];
    }
    double pair(int i, int j) const {
        return cost(0, i) + cost(1, j) + links_[1][static_cast<std::size_t>(i) * count(1) + j];
    }

    // Viterbi over pairs of candidates of neighbouring frame sets.
    void cheapest(std::span<PathChoice> out) const {
        const std::size_t last = frames_.size() - 1;
        if (last == 0) {
            out[0].candidate = 0;
            for (int k = 1; k < count(0); ++k)
                if (at(0, k).total() < at(0, out[0].candidate).total()) out[0].candidate = k;
            return;
        }
        std::vector<Costs> total(frames_.size());
        std::vector<std::vector<int>> from(frames_.size());
        for (int i = 0; i < count(0); ++i)
            for (int j = 0; j < count(1); ++j) total[1].push_back(pair(i, j));
        for (std::size_t n = 2; n <= last; ++n) {
            total[n].assign(static_cast<std::size_t>(count(n - 1)) * count(n), 0);
            from[n].assign(total[n].size(), 0);
            for (int j = 0; j < count(n - 1); ++j)
                for (int k = 0; k < count(n); ++k) {
                    double best = std::numeric_limits<double>::infinity();
                    int which = 0;
                    for (int i = 0; i < count(n - 2); ++i) {
                        const double so_far =
                            total[n - 1][static_cast<std::size_t>(i) * count(n - 1) + j] + triple(n, i, j, k);
                        if (so_far < best) best = so_far, which = i;
                    }
                    const std::size_t here = static_cast<std::size_t>(j) * count(n) + k;
                    total[n][here] = best + cost(n, k), from[n][here] = which;
                }
        }
        const auto end = std::min_element(total[last].begin(), total[last].end()) - total[last].begin();
        int k = static_cast<int>(end) % count(last), j = static_cast<int>(end) / count(last);
        for (std::size_t n = last; n >= 1; --n) {
            out[n].candidate = k;
            const int i = n >= 2 ? from[n][static_cast<std::size_t>(j) * count(n) + k] : 0;
            k = j, j = i;
        }
        out[0].candidate = k;
    }

    static double log_sum(const Costs& costs) {
        const double most = *std::max_element(costs.begin(), costs.end());
        double sum = 0;
        for (const double c : costs) sum += std::exp(c - most);
        return most + std::log(sum);
    }

    // The candidates' probabilities: forwards and backwards over the same pairs.
    void weigh(std::span<PathChoice> out) const {
        const std::size_t last = frames_.size() - 1;
        for (std::size_t n = 0; n <= last; ++n) out[n].probability.assign(count(n), 0);
        if (last == 0) {
            Costs single;
            for (int k = 0; k < count(0); ++k) single.push_back(-at(0, k).total() / kTemperature);
            const double all = log_sum(single);
            for (int k = 0; k < count(0); ++k) out[0].probability[k] = std::exp(single[k] - all);
            return;
        }
        std::vector<Costs> forward(frames_.size()), backward(frames_.size());
        for (int i = 0; i < count(0); ++i)
            for (int j = 0; j < count(1); ++j) forward[1].push_back(-pair(i, j) / kTemperature);
        Costs terms;
        for (std::size_t n = 2; n <= last; ++n)
            for (int j = 0; j < count(n - 1); ++j)
                for (int k = 0; k < count(n); ++k) {
                    terms.clear();
                    for (int i = 0; i < count(n - 2); ++i)
                        terms.push_back(forward[n - 1][static_cast<std::size_t>(i) * count(n - 1) + j] -
                                        triple(n, i, j, k) / kTemperature);
                    forward[n].push_back(log_sum(terms) - cost(n, k) / kTemperature);
                }
        backward[last].assign(forward[last].size(), 0);
        for (std::size_t n = last; n >= 2; --n)
            for (int i = 0; i < count(n - 2); ++i)
                for (int j = 0; j < count(n - 1); ++j) {
                    terms.clear();
                    for (int k = 0; k < count(n); ++k)
                        terms.push_back(backward[n][static_cast<std::size_t>(j) * count(n) + k] -
                                        (triple(n, i, j, k) + cost(n, k)) / kTemperature);
                    backward[n - 1].push_back(log_sum(terms));
                }
        for (std::size_t n = 1; n <= last; ++n) {
            Costs both(forward[n].size());
            for (std::size_t s = 0; s < both.size(); ++s) both[s] = forward[n][s] + backward[n][s];
            const double all = log_sum(both);
            for (int j = 0; j < count(n - 1); ++j)
                for (int k = 0; k < count(n); ++k) {
                    const double p = std::exp(both[static_cast<std::size_t>(j) * count(n) + k] - all);
                    out[n].probability[k] += p;
                    if (n == 1) out[0].probability[j] += p;
                }
        }
    }

    std::span<const PathFrame> frames_;
    std::array<double, kJointNames.size()> acceleration_;
    std::vector<Costs> links_;
    double share_ = 1;
};

}  // namespace

bool same_joints(const PathCandidate& a, const PathCandidate& b) {
    constexpr double kSameJoints_m = 0.03;
    return max_joint_distance(a.joints_in_world, b.joints_in_world) < kSameJoints_m;
}

bool is_known(const JointPositions& joints_in_world, std::span<const PathCandidate> known) {
    return std::ranges::any_of(known, [&](const PathCandidate& other) {
        return max_joint_distance(other.joints_in_world, joints_in_world) < kKnownJoints_m;
    });
}

bool is_worse(const PathCandidate& candidate, std::span<const PathCandidate> known) {
    return std::ranges::any_of(known, [&](const PathCandidate& other) {
        return other.cost <= candidate.cost && same_joints(other, candidate);
    });
}

std::vector<double> exchanged_legs_probability(std::span<const PathFrame> frames,
                                               std::span<const PathChoice> choices) {
    constexpr double kExchangedTemperature = 20;  // cost of a frame set per unit of log probability
    std::vector<double> own(frames.size(), 0);
    for (std::size_t n = 0; n < frames.size(); ++n) {
        if (choices[n].candidate < 0) continue;
        const PathCandidate& chosen = frames[n].candidates[choices[n].candidate];
        for (const PathCandidate& other : frames[n].candidates)
            if (has_exchanged_ankles(chosen.joints_in_world, other.joints_in_world))
                own[n] = std::max(own[n], 1 / (1 + std::exp(std::max(0.0, other.total() - chosen.total()) /
                                                            kExchangedTemperature)));
    }
    std::vector<double> around = own;
    for (std::size_t n = 0; n < frames.size(); ++n)
        for (std::size_t k = n + 1; k < frames.size() && frames[k].time_s - frames[n].time_s < kCorrelated_s;
             ++k)
            around[n] = std::max(around[n], own[k]), around[k] = std::max(around[k], own[n]);
    return around;
}

std::vector<PathChoice> choose_path(std::span<const PathFrame> frames) {
    std::vector<PathChoice> choices(frames.size());
    for (std::size_t begin = 0; begin < frames.size();) {
        if (frames[begin].candidates.empty()) {
            ++begin;
            continue;
        }
        std::size_t end = begin;
        while (end < frames.size() && !frames[end].candidates.empty()) ++end;
        Run(frames.subspan(begin, end - begin)).choose(std::span(choices).subspan(begin, end - begin));
        begin = end;
    }
    return choices;
}

}  // namespace kinevox
