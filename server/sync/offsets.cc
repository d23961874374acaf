#include "server/sync/offsets.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "server/sync/offset_search.h"

namespace kinevox::sync {
namespace {

constexpr int kMaxMoves = 8;         // of groups to where they fit better
constexpr double kClearly_nats = 6;  // by so much less evidence, a shift is out of the question
constexpr double kNarrowest_frames = 3;

// What a group's curve says of the shift 0.
struct Verdict {
    double evidence = 0;
    double quality = 0;  // evidence a picture
    double rival = 0;    // quality of the best other shift against this one's
    int rival_frames = 0;
    int better_frames = 0;   // not 0: all in all it fits better there
    double wide_frames = 0;  // on either side, where nothing speaks clearly against a shift
};

double quality(const GroupCurve& curve, int i) {
    return curve.overlap[i] > 0 ? curve.evidence[i] / curve.overlap[i] : 0;
}

Verdict judge(const GroupCurve& curve, const OffsetOptions& options) {
    const int size = static_cast<int>(curve.evidence.size()), middle = size / 2;
    Verdict out;
    out.evidence = curve.evidence[middle];
    const double here = out.quality = quality(curve, middle);
    if (!(here > 0)) return out;
    // The peak's own flanks are no rivals.
    int ends[2];
    for (const int side : {0, 1}) {
        const int step = side ? 1 : -1;
        int i = middle, wide = middle;
        while (i + step >= 0 && i + step < size &&
               (quality(curve, i) > options.rival_quality * here ||
                curve.evidence[i + step] <= curve.evidence[i])) {
            i += step;
            if (curve.evidence[i] > out.evidence - kClearly_nats && std::abs(i - wide) == 1) wide = i;
        }
        ends[side] = i;
        out.wide_frames = std::max(out.wide_frames, static_cast<double>(std::abs(wide - middle)));
    }
    double most = out.evidence;
    for (int i = 0; i < size; ++i) {
        if (curve.evidence[i] > most) most = curve.evidence[i], out.better_frames = i - middle;
        if ((i >= ends[0] && i <= ends[1]) ||
            curve.overlap[i] < options.rival_overlap * curve.overlap[middle])
            continue;
        if (const double there = quality(curve, i) / here; there > out.rival)
            out.rival = there, out.rival_frames = i - middle;
    }
    return out;
}

struct Judged {
    Group group;
    double tied = 0;  // how well, against what is needed: 1 is just enough
    Verdict verdict;
};

bool any_equal(const std::vector<PairEvidence>& pairs, const Group& group) {
    return std::ranges::any_of(pairs, [&](const PairEvidence& pair) {
        return pair.has_equal() && group[pair.first()] != group[pair.second()];
    });
}

// Evidence a picture of the best quarter of the pairs that see something equal; 0 without any.
double best_quality(const std::vector<PairEvidence>& pairs, const std::vector<int>& offsets) {
    std::vector<double> all;
    for (const PairEvidence& pair : pairs) {
        const int lag = offsets[pair.second()] - offsets[pair.first()];
        if (pair.has_equal() && pair.overlap(lag) > 0) all.push_back(pair.at(lag) / pair.overlap(lag));
    }
    if (all.empty()) return 0;
    const auto quarter = all.begin() + static_cast<std::ptrdiff_t>(all.size() / 4);
    std::ranges::nth_element(all, quarter, std::greater());
    return *quarter;
}

double how_tied(const Verdict& verdict, bool equal, double best, const OffsetOptions& options) {
    if (!equal) return verdict.evidence / options.min_evidence;
    const double enough = verdict.evidence / options.min_evidence_equal;
    return best > 0 ? std::min(enough, verdict.quality / (options.min_part * best)) : enough;
}

std::string names_of(const Group& group, std::span<const std::string> names) {
    std::vector<std::string> members;
    for (std::size_t c = 0; c < group.size(); ++c)
        if (group[c]) members.push_back(names[c]);
    return fmt::format("{} {}", members.size() == 1 ? "camera" : "cameras", fmt::join(members, ", "));
}

absl::Status untied(const Judged& worst, std::span<const std::string> names, const OffsetOptions& options) {
    return absl::FailedPreconditionError(fmt::format(
        "{}: no shift up to {:g} s fits the others well enough (the best one by {:.0f} % of what is "
        "needed). Either nobody moves while "
        "both see them, or it is another recording, or it began earlier or later than that; record "
        "somebody who moves in view "
        "of all cameras, such as a jump, or give a larger --max-shift",
        names_of(worst.group, names), options.max_shift_s, 100 * std::max(0.0, worst.tied)));
}

absl::Status ambiguous(const Judged& worst, std::span<const std::string> names,
                       const OffsetOptions& options) {
    return absl::FailedPreconditionError(
        fmt::format("{}: fits the others at two shifts that are {:.3f} s apart, the second {:.0f} % as well "
                    "as the first, as "
                    "when a movement "
                    "repeats itself; record a movement that does not, such as one jump, or give a "
                    "--max-shift that leaves one of "
                    "them out",
                    names_of(worst.group, names), std::abs(worst.verdict.rival_frames) / options.fps,
                    100 * worst.verdict.rival));
}

absl::Status blurred(const Judged& worst, std::span<const std::string> names, const OffsetOptions& options) {
    return absl::FailedPreconditionError(fmt::format(
        "{}: its shift against the others cannot be told to within {:.2f} s, since the movement is too "
        "slow; record something "
        "quick, such as a jump",
        names_of(worst.group, names), worst.verdict.wide_frames / options.fps));
}

// All pairs' tables and the whole offsets, with the scatter of what is equal taken from there.
std::vector<int> search(std::vector<PairEvidence>& pairs, std::size_t cameras, int most) {
    std::vector<int> whole;
    for (int round = 0; round < 2; ++round) {
        for (PairEvidence& pair : pairs) {
            if (round > 0) pair.settle(whole[pair.second()] - whole[pair.first()]);
            pair.tabulate(-most, most);
        }
        whole = whole_offsets(pairs, cameras, most);
    }
    return whole;
}

// What is equal must be so: near enough for each camera against the others.
absl::Status check_misses(const FineOffsets& fine, std::span<const std::string> names,
                          const OffsetOptions& options) {
    for (std::size_t c = 0; c < names.size(); ++c) {
        std::vector<double> misses;
        for (const PairFit& pair : fine.pairs)
            if (pair.miss_px && (pair.first == c || pair.second == c)) misses.push_back(*pair.miss_px);
        if (misses.empty()) continue;
        const auto middle = misses.begin() + static_cast<std::ptrdiff_t>(misses.size() / 2);
        std::ranges::nth_element(misses, middle);
        if (*middle <= options.max_miss_px * options.pixel_px) continue;
        return absl::FailedPreconditionError(fmt::format(
            "camera {}: its silhouettes miss those of the others by {:.1f} px even where they fit best: "
            "it is of another recording, "
            "or stands elsewhere than its calibration says; correct that, or give --no-places to go by "
            "the movement alone",
            names[c], *middle));
    }
    return absl::OkStatus();
}

}  // namespace

absl::StatusOr<OffsetSolution> solve_offsets(std::vector<PairEvidence>& pairs,
                                             std::span<const std::string> names,
                                             const OffsetOptions& options) {
    const std::size_t cameras = names.size();
    const int most = static_cast<int>(std::lround(options.max_shift_s * options.fps));
    std::vector<int> whole = search(pairs, cameras, most);

    const std::vector<Group> groups = ways_to_part(pairs, cameras, whole);
    std::vector<Judged> judged;
    for (int move = 0; move < kMaxMoves; ++move) {
        judged.clear();
        const Judged* better = nullptr;
        const double best = best_quality(pairs, whole);
        for (const Group& group : groups) {
            const Verdict verdict = judge(group_curve(pairs, group, whole, most), options);
            judged.push_back({group, how_tied(verdict, any_equal(pairs, group), best, options), verdict});
        }
        for (const Judged& one : judged)
            if (one.verdict.better_frames != 0) better = &one;
        if (!better) break;
        for (std::size_t c = 0; c < cameras; ++c)
            if (better->group[c]) whole[c] += better->verdict.better_frames;
    }
    const auto by = [&](auto of) { return *std::ranges::min_element(judged, {}, of); };
    const Judged weakest = by([](const Judged& j) { return j.tied; });
    if (weakest.tied < 1) return untied(weakest, names, options);
    const Judged rivalled = by([](const Judged& j) { return -j.verdict.rival; });
    if (rivalled.verdict.rival > options.rival_quality) return ambiguous(rivalled, names, options);
    const Judged widest = by([](const Judged& j) { return -j.verdict.wide_frames; });
    if (widest.verdict.wide_frames > std::max(kNarrowest_frames, options.widest_s * options.fps))
        return blurred(widest, names, options);

    const FineOffsets fine = fine_offsets(pairs, cameras, whole);
    if (absl::Status fits = check_misses(fine, names, options); !fits.ok()) return fits;
    for (std::size_t c = 0; c < cameras; ++c)
        if (std::ranges::none_of(fine.pairs, [&](const PairFit& p) {
                return p.weight > 0 && (p.first == c || p.second == c);
            })) {
            Judged lonely{
                Group(cameras, false), 0, {}};  // best where the search ends, or nowhere in particular
            lonely.group[c] = true;
            return untied(lonely, names, options);
        }

    OffsetSolution out;
    out.pairs = fine.pairs;
    const double earliest = *std::ranges::min_element(fine.frames);
    for (std::size_t c = 0; c < cameras; ++c) {
        CameraFit& fit = out.cameras.emplace_back();
        fit.offset_s = (fine.frames[c] - earliest) / options.fps;
        fit.deviation_s = fine.deviation_frames[c] / options.fps;
        fit.evidence = std::numeric_limits<double>::max();
        for (const Judged& one : judged) {
            const auto members = static_cast<std::size_t>(std::ranges::count(one.group, true));
            if (!one.group[c] && 2 * members != cameras) continue;
            fit.evidence = std::min(fit.evidence, one.verdict.evidence);
            if (one.verdict.rival > fit.rival) {
                fit.rival = one.verdict.rival;
                fit.rival_shift_s = (one.group[c] ? 1 : -1) * one.verdict.rival_frames / options.fps;
            }
        }
        Group alone(cameras, false);
        alone[c] = true;
        fit.curve = {-most, group_curve(pairs, alone, whole, most).evidence};
    }
    return out;
}

}  // namespace kinevox::sync
