#include "server/sync/offsets.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>

#include "common/median.h"
#include "server/sync/offset_search.h"

namespace kinevox::sync {
namespace {

constexpr int kMaxMoves = 8;         // of groups to a better shift
constexpr double kClearly_nats = 6;  // a shift with this much less evidence is rejected
constexpr double kMinPeakWidth_frames = 3;

// Verdict of a group's curve on shift 0.
struct ShiftVerdict {
    double evidence = 0;
    double quality = 0;    // evidence per image
    double runner_up = 0;  // quality of the best other shift against this one's
    int runner_up_frames = 0;
    int better_frames = 0;   // not 0: the total evidence is larger there
    double wide_frames = 0;  // on either side, without clear evidence against a shift
};

double quality(const GroupCurve& curve, int i) {
    return curve.overlap[i] > 0 ? curve.evidence[i] / curve.overlap[i] : 0;
}

ShiftVerdict judge(const GroupCurve& curve, const OffsetOptions& options) {
    const int size = static_cast<int>(curve.evidence.size()), middle = size / 2;
    ShiftVerdict out;
    out.evidence = curve.evidence[middle];
    const double here = out.quality = quality(curve, middle);
    if (!(here > 0)) return out;
    // The peak's own flanks are no runners-up.
    int ends[2];
    for (const int side : {0, 1}) {
        const int step = side ? 1 : -1;
        int i = middle, wide = middle;
        while (i + step >= 0 && i + step < size &&
               (quality(curve, i) > options.runner_up_quality * here ||
                curve.evidence[i + step] <= curve.evidence[i])) {
            i += step;
            if (curve.evidence[i] > out.evidence - kClearly_nats && std::abs(i - wide) == 1) wide = i;
        }
        ends[side] = i;
        out.wide_frames = std::max(out.wide_frames, static_cast<double>(std::abs(wide - middle)));
    }
    double best = out.evidence;
    for (int i = 0; i < size; ++i) {
        if (curve.evidence[i] > best) best = curve.evidence[i], out.better_frames = i - middle;
        if ((i >= ends[0] && i <= ends[1]) ||
            curve.overlap[i] < options.runner_up_overlap * curve.overlap[middle])
            continue;
        if (const double there = quality(curve, i) / here; there > out.runner_up)
            out.runner_up = there, out.runner_up_frames = i - middle;
    }
    return out;
}

struct Judged {
    Group group;
    double tied = 0;  // evidence relative to the minimum: 1 is just enough
    ShiftVerdict verdict;
};

bool any_equal(const std::vector<PairEvidence>& pairs, const Group& group) {
    return std::ranges::any_of(pairs, [&](const PairEvidence& pair) {
        return pair.has_equal() && group[pair.first()] != group[pair.second()];
    });
}

// Evidence per image of the best quarter of the pairs with equal signals; 0 without any.
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

double how_tied(const ShiftVerdict& verdict, bool equal, double best, const OffsetOptions& options) {
    if (!equal) return verdict.evidence / options.min_evidence;
    const double enough = verdict.evidence / options.min_evidence_equal;
    return best > 0 ? std::min(enough, verdict.quality / (options.min_quality_fraction * best)) : enough;
}

std::string names_of(const Group& group, std::span<const std::string> names) {
    std::vector<std::string> members;
    for (std::size_t c = 0; c < group.size(); ++c)
        if (group[c]) members.push_back(names[c]);
    return fmt::format("{} {}", members.size() == 1 ? "camera" : "cameras", fmt::join(members, ", "));
}

absl::Status untied(const Judged& worst, std::span<const std::string> names, const OffsetOptions& options) {
    return absl::FailedPreconditionError(fmt::format(
        "{}: no shift up to {:g} s matches the others (the best one has {:.0f} % of the evidence needed). No "
        "person moves in shared view, it is another recording, or the offset is larger; record a movement in "
        "view of all cameras, such as a jump, or give a larger --max-offset",
        names_of(worst.group, names), options.max_offset_s, 100 * std::max(0.0, worst.tied)));
}

absl::Status ambiguous(const Judged& worst, std::span<const std::string> names,
                       const OffsetOptions& options) {
    return absl::FailedPreconditionError(fmt::format(
        "{}: matches the others at two shifts {:.3f} s apart, the second {:.0f} % as good as the "
        "first, as with a repeating movement; record one that does not repeat, such as a jump, or "
        "give a --max-offset that excludes one of them",
        names_of(worst.group, names), std::abs(worst.verdict.runner_up_frames) / options.fps,
        100 * worst.verdict.runner_up));
}

absl::Status blurred(const Judged& worst, std::span<const std::string> names, const OffsetOptions& options) {
    return absl::FailedPreconditionError(
        fmt::format("{}: its shift against the others is uncertain by {:.2f} s, because the movement is too "
                    "slow; record a "
                    "fast one, such as a jump",
                    names_of(worst.group, names), worst.verdict.wide_frames / options.fps));
}

// All pairs' tables and the whole offsets, with the scatter of equal signals estimated there.
std::vector<int> search(std::vector<PairEvidence>& pairs, std::size_t cameras, int max_lag) {
    std::vector<int> whole;
    for (int round = 0; round < 2; ++round) {
        for (PairEvidence& pair : pairs) {
            if (round > 0) pair.fix_scatter(whole[pair.second()] - whole[pair.first()]);
            pair.tabulate(-max_lag, max_lag);
        }
        whole = whole_offsets(pairs, cameras, max_lag);
    }
    return whole;
}

// Equal signals must be close enough for each camera against the others.
absl::Status check_residuals(const FineOffsets& fine, std::span<const std::string> names,
                             const OffsetOptions& options) {
    for (std::size_t c = 0; c < names.size(); ++c) {
        std::vector<double> residuals;
        for (const PairFit& pair : fine.pairs)
            if (pair.residual_px && (pair.first == c || pair.second == c))
                residuals.push_back(*pair.residual_px);
        if (residuals.empty()) continue;
        const double residual_px = median_of(residuals);
        if (residual_px <= options.max_residual_px * options.pixel_px) continue;
        return absl::FailedPreconditionError(
            fmt::format("camera {}: its silhouettes are inconsistent with the others by {:.1f} px even at "
                        "the best offset: it "
                        "belongs to another recording, or its extrinsics are wrong; correct that, or give "
                        "--no-extrinsics",
                        names[c], residual_px));
    }
    return absl::OkStatus();
}

constexpr double kMinSeconds = 1;      // with a person in the image
constexpr double kHardlyMoves = 0.01;  // changed fraction of the silhouette per image; noise alone is below

constexpr double kPixels = 640;  // along the longer side: the unit of scatter and residuals

absl::Status check_seen(const std::vector<CameraMotion>& cameras, double fps) {
    for (const CameraMotion& camera : cameras) {
        const auto seen =
            std::ranges::count_if(camera.shapes, [](const SilhouetteShape& shape) { return shape.seen; });
        if (static_cast<double>(seen) >= kMinSeconds * fps) continue;
        return absl::FailedPreconditionError(fmt::format(
            "camera {}: a person is visible in only {} of {} images; {:g} s are needed. Check that its "
            "background belongs to this session and that the person walks through its view",
            camera.camera.name, seen, camera.shapes.size(), kMinSeconds));
    }
    return absl::OkStatus();
}

}  // namespace

absl::StatusOr<OffsetSolution> solve_offsets(std::vector<PairEvidence>& pairs,
                                             std::span<const std::string> names,
                                             const OffsetOptions& options) {
    const std::size_t cameras = names.size();
    const int max_lag = static_cast<int>(std::lround(options.max_offset_s * options.fps));
    std::vector<int> whole = search(pairs, cameras, max_lag);

    const std::vector<Group> groups = bipartitions(pairs, cameras, whole);
    std::vector<Judged> judged;
    for (int move = 0; move < kMaxMoves; ++move) {
        judged.clear();
        const Judged* better = nullptr;
        const double best = best_quality(pairs, whole);
        for (const Group& group : groups) {
            const ShiftVerdict verdict = judge(group_curve(pairs, group, whole, max_lag), options);
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
    const Judged ambiguous_group = by([](const Judged& j) { return -j.verdict.runner_up; });
    if (ambiguous_group.verdict.runner_up > options.runner_up_quality)
        return ambiguous(ambiguous_group, names, options);
    const Judged blurred_group = by([](const Judged& j) { return -j.verdict.wide_frames; });
    if (blurred_group.verdict.wide_frames >
        std::max(kMinPeakWidth_frames, options.max_peak_width_s * options.fps))
        return blurred(blurred_group, names, options);

    const FineOffsets fine = fine_offsets(pairs, cameras, whole);
    if (absl::Status fits = check_residuals(fine, names, options); !fits.ok()) return fits;
    for (std::size_t c = 0; c < cameras; ++c)
        if (std::ranges::none_of(fine.pairs, [&](const PairFit& p) {
                return p.weight > 0 && (p.first == c || p.second == c);
            })) {
            Judged lonely{Group(cameras, false), 0, {}};  // without a peak inside the search range
            lonely.group[c] = true;
            return untied(lonely, names, options);
        }

    OffsetSolution out;
    out.pairs = fine.pairs;
    const double earliest = *std::ranges::min_element(fine.frames);
    for (std::size_t c = 0; c < cameras; ++c) {
        CameraFit& fit = out.cameras.emplace_back();
        fit.offset_s = (fine.frames[c] - earliest) / options.fps;
        fit.std_s = fine.std_frames[c] / options.fps;
        fit.evidence = std::numeric_limits<double>::max();
        for (const Judged& one : judged) {
            const auto members = static_cast<std::size_t>(std::ranges::count(one.group, true));
            if (!one.group[c] && 2 * members != cameras) continue;
            fit.evidence = std::min(fit.evidence, one.verdict.evidence);
            if (one.verdict.runner_up > fit.runner_up) {
                fit.runner_up = one.verdict.runner_up;
                fit.runner_up_offset_s = (one.group[c] ? 1 : -1) * one.verdict.runner_up_frames / options.fps;
            }
        }
        Group alone(cameras, false);
        alone[c] = true;
        fit.curve = {-max_lag, group_curve(pairs, alone, whole, max_lag).evidence};
    }
    return out;
}

absl::StatusOr<Alignment> align(const std::vector<CameraMotion>& cameras, double fps,
                                const AlignOptions& options) {
    if (cameras.size() < 2)
        return absl::FailedPreconditionError("the session has one camera; alignment needs at least two");
    if (absl::Status seen = check_seen(cameras, fps); !seen.ok()) return seen;
    Alignment out;
    EvidenceOptions evidence;
    OffsetOptions offsets;
    evidence.fps = offsets.fps = fps;
    offsets.max_offset_s = options.max_offset_s;
    int max_px = 0;
    for (const CameraMotion& camera : cameras)
        max_px = std::max({max_px, camera.camera.width, camera.camera.height});
    evidence.pixel_px = offsets.pixel_px = max_px / kPixels;
    std::vector<std::string> names;
    for (const CameraMotion& camera : cameras) {
        names.push_back(camera.camera.name);
        out.movements.push_back(movement_signals(camera, fps));
    }
    std::vector<PairEvidence> pairs;
    for (PairSignals& signals : pair_signals(cameras, fps, {options.use_extrinsics})) {
        out.used_extrinsics = out.used_extrinsics || !signals.equal_px.empty();
        pairs.emplace_back(std::move(signals), evidence);
    }
    auto solution = solve_offsets(pairs, names, offsets);
    if (!solution.ok()) {
        // The cause is more useful than the failure.
        for (std::size_t c = 0; c < cameras.size(); ++c)
            if (out.movements[c].hardly_moves < kHardlyMoves)
                return absl::FailedPreconditionError(fmt::format("{} (camera {}: the person hardly moves)",
                                                                 std::string(solution.status().message()),
                                                                 names[c]));
        return solution.status();
    }
    out.solution = *std::move(solution);
    return out;
}

}  // namespace kinevox::sync
