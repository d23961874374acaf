// Causes that the images show: light, background, people, objects, the field of view.
#include <fmt/format.h>

#include <algorithm>

#include "server/quality/judges.h"

namespace kinevox::quality {
namespace {

// docs/quality.md lists the values measured on good and spoiled sessions next to each threshold.
constexpr double kDarkMeanLevel = 25;
constexpr double kMaxDarkFraction = 0.6;
constexpr double kMaxSaturatedFraction = 0.25;
constexpr double kMaxGhostFraction = 0.3, kSomeGhostFraction = 0.135;
constexpr double kMinStillAreaRatio = 0.1;
constexpr double kStillInBackground = 0.5;
constexpr double kMinSeveralFraction = 0.3;
constexpr double kMinMergedFraction = 0.1;  // of the frame sets, with people not separated
constexpr double kMaxTruncatedFraction = 0.5, kMinSeenFraction = 0.5;
constexpr double kMinSubjectFraction = 0.3;

// The camera with the largest value.
template <class Value>
const CameraMeasurements& worst_of(const Measurements& seen, Value value) {
    return *std::ranges::max_element(seen.cameras, {}, value);
}

}  // namespace

Judgement judge_light(const Measurements& seen) {
    if (seen.cameras.empty()) return {};
    const auto darkness = [](const CameraMeasurements& camera) { return camera.dark_fraction; };
    const CameraMeasurements& dark = worst_of(seen, darkness);
    if (dark.mean_level < kDarkMeanLevel && dark.dark_fraction > kMaxDarkFraction / 2)
        return Cause{
            Trust::kDoNotUse, "too_dark", dark.name,
            fmt::format("camera {} is too dark: mean grey level {:.0f} of 255, {:.0f} % of the image "
                        "is black",
                        dark.name, dark.mean_level, 100 * dark.dark_fraction),
            "add light, open the aperture or expose longer, and learn the background again"};
    const auto brightness = [](const CameraMeasurements& camera) { return camera.saturated_fraction; };
    const CameraMeasurements& bright = worst_of(seen, brightness);
    if (bright.saturated_fraction > kMaxSaturatedFraction)
        return Cause{Trust::kDoNotUse, "saturated", bright.name,
                     fmt::format("camera {} is overexposed: {:.0f} % of the image is saturated", bright.name,
                                 100 * bright.saturated_fraction),
                     "reduce exposure, gain or light, and learn the background again"};
    return {};
}

Judgement judge_background(const Measurements& seen) {
    for (const CameraMeasurements& camera : seen.cameras)
        if (camera.still_area_ratio > kMinStillAreaRatio &&
            camera.still_in_background_fraction > kStillInBackground)
            return Cause{
                Trust::kDoNotUse, "background_occupied", camera.name,
                fmt::format("the background of camera {} holds a person or an object that is not "
                            "there during the session",
                            camera.name),
                "record or learn the background again with the scene as in the session and no person "
                "in it"};
    if (seen.cameras.empty()) return {};
    // One camera much, or most of them somewhat: a moved lamp or shadow makes ghosts in one.
    const auto ghosts = [](const CameraMeasurements& camera) { return camera.ghost_contour_fraction; };
    const CameraMeasurements& camera = worst_of(seen, ghosts);
    const auto some = std::ranges::count_if(
        seen.cameras, [&](const CameraMeasurements& each) { return ghosts(each) > kSomeGhostFraction; });
    if (camera.ghost_contour_fraction <= kMaxGhostFraction &&
        4 * some < 3 * static_cast<std::ptrdiff_t>(seen.cameras.size()))
        return {};
    return Cause{Trust::kDoNotUse, "background_occupied", camera.name,
                 fmt::format("{:.0f} % of the silhouettes' contours of camera {} come from its background's "
                             "images: a person was in the scene while it was learned",
                             100 * camera.ghost_contour_fraction, camera.name),
                 "record or learn the background again with no person in the scene"};
}

Judgement judge_people(const Measurements& seen) {
    if (seen.followed_subjects > 1 || seen.subjects_selected ||
        seen.several_people_fraction < kMinSeveralFraction)
        return {};
    const bool merged = seen.merged_people_fraction >= kMinMergedFraction;
    return Cause{merged ? Trust::kDoNotUse : Trust::kCaution, "several_people", "",
                 fmt::format("several people are in the scene in {:.0f} % of the frame sets{}",
                             100 * seen.several_people_fraction,
                             merged ? "" : "; one of them is followed, the others are excluded"),
                 "follow each of them (tracking.max_subjects, kinevox process --max-subjects), or record "
                 "with one person in the cameras' common view"};
}

Judgement judge_still_object(const Measurements& seen) {
    const CameraMeasurements* largest = nullptr;
    int cameras = 0;
    for (const CameraMeasurements& camera : seen.cameras) {
        if (camera.still_area_ratio <= kMinStillAreaRatio ||
            camera.still_in_background_fraction > kStillInBackground)
            continue;
        ++cameras;
        if (!largest || camera.still_area_ratio > largest->still_area_ratio) largest = &camera;
    }
    if (cameras < 2) return {};
    return Cause{Trust::kCaution, "still_object", largest->name,
                 fmt::format("an object that the background does not show stands still in {} cameras; in {} "
                             "it covers {:.0f} % of the subject's area",
                             cameras, largest->name, 100 * largest->still_area_ratio),
                 "remove it, or learn the background again with it in place"};
}

Judgement judge_view(const Measurements& seen) {
    if (seen.pose.subject_fraction < kMinSubjectFraction)
        return Cause{Trust::kDoNotUse, "no_subject", "",
                     fmt::format("a subject is tracked in {:.0f} % of the frame sets only",
                                 100 * seen.pose.subject_fraction),
                     "check that at least two cameras see the whole subject, and the calibration"};
    int cut = 0;
    const CameraMeasurements* worst = nullptr;
    for (const CameraMeasurements& camera : seen.cameras) {
        const double fraction = camera.truncated_fraction + 1 - camera.seen_fraction;
        if (camera.truncated_fraction <= kMaxTruncatedFraction && camera.seen_fraction >= kMinSeenFraction)
            continue;
        ++cut;
        if (!worst || fraction > worst->truncated_fraction + 1 - worst->seen_fraction) worst = &camera;
    }
    if (!worst || 2 * cut < static_cast<int>(seen.cameras.size())) return {};
    return Cause{Trust::kDoNotUse, "out_of_view", worst->name,
                 fmt::format("the subject is cut by the image border or outside the image in {} of {} "
                             "cameras; in {} in {:.0f} % of the frame sets",
                             cut, seen.cameras.size(), worst->name,
                             100 * std::min(1.0, worst->truncated_fraction + 1 - worst->seen_fraction)),
                 "move cameras back, use shorter focal lengths, or keep the subject in the common view"};
}

}  // namespace kinevox::quality
