// SceneTracker: whether a part is a newcomer, who that is, and who of those tracked is followed.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "kernels/projection.h"
#include "server/pipeline/for_each_camera.h"
#include "server/pipeline/subject_control.h"
#include "server/pipeline/tracking/scene_tracker.h"
#include "server/silhouettes/mask_box.h"

namespace kinevox {
namespace {

constexpr double kMaxPendingJump_m = 0.4;
constexpr double kRememberInterval_s = 0.2;
constexpr double kLoneInterval_s = 1;          // of a lone subject, so that it costs no time
constexpr std::size_t kFirstObservations = 8;  // of it, at the shorter interval
constexpr double kMinGroup_m = 0.7;            // extent of two people's volume
constexpr double kApart_m = 0.2;  // between two subjects' boxes, if neither has cells of the other

// Of a new subject's pixels in a view, those that no other explains. Of a ghost there are hardly any; who is
// half hidden in all views has a few in many.
constexpr double kClearlyNew = 0.35, kPartlyNew = 0.2;
constexpr int kMinClearViews = 2, kMinPartViews = 3;

bool are_beside(const CellStatistics& a, const CellStatistics& b) {
    return a.min_in_world.x < b.max_in_world.x + kApart_m && a.max_in_world.x > b.min_in_world.x - kApart_m &&
           a.min_in_world.y < b.max_in_world.y + kApart_m && a.max_in_world.y > b.min_in_world.y - kApart_m;
}

}  // namespace

// Whether this part explains pixels of the silhouettes that nothing else does; if so, adds its projection to
// `explained`.
SceneTracker::Need SceneTracker::need_of(const Cells& part, const SilhouettesByCamera& silhouettes,
                                         std::vector<std::vector<std::uint8_t>>& explained) const {
    const kernels::VoxelVolume volume = grid_.volume_of(part);
    std::vector<std::vector<std::uint8_t>> masks(cameras_.size());
    std::vector<kernels::Rect> boxes(cameras_.size());
    std::vector<double> fraction(cameras_.size(), 0);
    for_each_camera(cameras_.size(), [&](std::size_t c) {
        if (!silhouettes[c] || silhouettes[c]->sharp.empty()) return;
        const kernels::Silhouettes& seen = *silhouettes[c];
        masks[c].resize(seen.sharp.size());
        const float still[3] = {0, 0, 0};
        kernels::Rect& box = boxes[c];
        kernels::project_volume(volume, models_[c], still, 1, masks[c].data(), box);
        std::int64_t inside = 0, more = 0;
        for (int y = box.y0; y < box.y1; ++y)
            for (int x = box.x0; x < box.x1; ++x) {
                const std::size_t at = static_cast<std::size_t>(y) * seen.width + x;
                if (!masks[c][at] || !seen.sharp[at]) continue;
                ++inside;
                more += !explained[c][at];
            }
        if (inside > 0) fraction[c] = static_cast<double>(more) / static_cast<double>(inside);
    });
    const auto views_above = [&](double limit) {
        return std::ranges::count_if(fraction, [&](double f) { return f >= limit; });
    };
    // An arm or half a person is needed only by the views that do not show the rest.
    const CellStatistics s = grid_.statistics(part);
    const std::ptrdiff_t images = std::ranges::count_if(silhouettes, [](const auto* each) { return each; });
    const bool whole = s.litres >= kMinTrunk_litres && !lacks_legs(s);
    if (views_above(kPartlyNew) < std::min<std::ptrdiff_t>(kMinPartViews, images) &&
        !(whole && views_above(kClearlyNew) >= kMinClearViews))
        return Need::kNone;
    for (std::size_t c = 0; c < cameras_.size(); ++c)
        add_box(masks[c], cameras_[c].width, boxes[c], explained[c]);
    return views_above(kClearlyNew) > kMinClearViews ? Need::kManyViews : Need::kSomeViews;
}

// Who is not certain yet keeps their cells in the next frame set: a subject beside would grow into them.
void SceneTracker::keep_beside(const Cells& person) {
    if (grid_.statistics(person).litres < kMinTrunk_litres) return;
    std::erase_if(beside_,
                  [&](const Cells& each) { return std::ranges::find(person, each.front()) != person.end(); });
    beside_.push_back(person);
}

// This part as a newcomer, with what is pending near it.
SceneTracker::Pending SceneTracker::continued(const Cells& person, std::int64_t time_ns) const {
    Pending now{grid_.statistics(person).centre_in_world, time_ns, {}};
    if (!views_.empty()) now.appearance = appearance_of(grid_, person, views_);
    const Pending* longest = nullptr;
    for (const Pending& before : pending_)
        if (norm(before.centre_in_world - now.centre_in_world) < kMaxPendingJump_m &&
            (!longest || before.since_ns < longest->since_ns))
            longest = &before;
    if (!longest) return now;
    now.since_ns = std::min(longest->since_ns, time_ns);
    add_appearance(now.appearance, longest->appearance);
    return now;
}

// Whether a newcomer starts now; with `known` as a person who returns. `certain`: needs no confirmation.
bool SceneTracker::decide(const Pending& newcomer, bool certain, std::int64_t time_ns,
                          std::optional<Recognition>& known) const {
    known.reset();
    const double pending_s = 1e-9 * static_cast<double>(time_ns - newcomer.since_ns);
    if (!certain && pending_s < options_.confirm_s) return false;
    std::vector<std::uint32_t> present;
    // A track may stray to a ghost or to a person beside, while its own person appears as a newcomer.
    for (const Subject& subject : subjects_)
        if (subject.seen &&
            (views_.empty() || !memory_.has_strayed(subject.id, appearance_of(grid_, subject.cells, views_),
                                                    newcomer.appearance)))
            present.push_back(subject.id);
    const std::int64_t since_ns = remembered_since_ns(time_ns);
    if (views_.empty() || !memory_.knows_absent(present, since_ns)) return true;
    known = memory_.recognise(newcomer.appearance, newcomer.centre_in_world, time_ns, present, since_ns);
    if (!known || known->probability >= SubjectMemory::kMinProbability) return true;
    const bool may_wait = pending_s < options_.confirm_s + kMaxUndecided_s;
    if (may_wait && known->probability >= SubjectMemory::kMinPossible) return false;
    known.reset();
    return true;
}

std::int64_t SceneTracker::remembered_since_ns(std::int64_t time_ns) const {
    return time_ns - static_cast<std::int64_t>(1e9 * options_.recognise_within_s);
}

bool SceneTracker::is_remembering_due(std::int64_t time_ns, double interval_s) {
    const double since_s = 1e-9 * static_cast<double>(time_ns - last_remembered_ns_);
    if (views_.empty() || (since_s >= 0 && since_s < interval_s)) return false;
    last_remembered_ns_ = time_ns;
    return true;
}

// Colours and size of those who stand apart.
void SceneTracker::remember(std::int64_t time_ns) {
    const bool due = is_remembering_due(time_ns, kRememberInterval_s);
    for (const Subject& subject : subjects_) {
        if (!subject.seen) continue;
        const bool apart = std::ranges::none_of(subjects_, [&](const Subject& other) {
            return other.id != subject.id && are_beside(other.shape, subject.shape);
        });
        if (due && apart && is_upright(subject.cells))
            memory_.observe(subject.id, appearance_of(grid_, subject.cells, views_));
        memory_.place(subject.id, time_ns, subject.shape.centre_in_world);
    }
}

// Frees the cells of newcomers next to subjects, which find_new() judges.
void SceneTracker::keep_newcomers() {
    if (beside_.empty()) return;
    beside_.clear();
    for (Cells& part : grid_.parts(kNewcomersLabel)) {
        grid_.free(part);
        if (is_upright(part)) beside_.push_back(std::move(part));
    }
}

// Of a subject that has grown: frees what another person adds who appears next to it, and returns the
// others: the trunk nearest to where the subject was before it grew.
Cells SceneTracker::without_newcomers(const Subject& subject, Cells own) {
    std::vector<Cells> shares = split_by_trunks(grid_, own);
    if (std::ranges::count_if(shares, [&](const Cells& share) { return is_upright(share); }) < 2) return own;
    const auto distance_m = [&](const Cells& share) {
        const Vec3 offset = grid_.statistics(share).centre_in_world - subject.usual_centre;
        return std::hypot(offset.x, offset.y);
    };
    const auto kept = std::ranges::min_element(shares, {}, distance_m);
    for (auto share = shares.begin(); share != shares.end(); ++share)
        if (share != kept) grid_.free(*share), beside_.push_back(std::move(*share));
    return std::move(*kept);
}

void SceneTracker::observe_lone(const TrackedState& subject, std::int64_t time_ns,
                                const SilhouettesByCamera& silhouettes,
                                std::span<const kernels::ImageView> images) {
    subjects_.clear();
    look_at(silhouettes, images);
    const double interval_s =
        memory_.observations(subject.id) < kFirstObservations ? kRememberInterval_s : kLoneInterval_s;
    if (is_remembering_due(time_ns, interval_s)) {
        const double margin = options_.region_margin_m;
        const Vec3 wide{margin, margin, margin};
        grid_.clear();
        whole_images_ = false;
        carve_in(grid_.part_over(
                     {subject.box_in_world.min_in_world - wide, subject.box_in_world.max_in_world + wide}),
                 silhouettes);
        const std::vector<Cells> parts = grid_.parts(OccupiedCells::kFree);
        if (!parts.empty() && is_upright(parts[0]))
            memory_.observe(subject.id, appearance_of(grid_, parts[0], views_));
    }
    memory_.place(subject.id, time_ns, subject.filter.centre_in_world());
}

bool SceneTracker::holds_several(const kernels::VoxelVolume& shape, const kernels::VoxelVolume& before) {
    const Cells cells = grid_.cells_of(shape);
    const CellStatistics whole = grid_.statistics(cells);
    const Vec3 extent = whole.max_in_world - whole.min_in_world;
    if (cells.empty() || std::max(extent.x, extent.y) < kMinGroup_m) return false;
    const Cells alone = grid_.cells_of(before);
    if (!alone.empty() &&
        static_cast<double>(cells.size()) > kMaxGrowthRatio * static_cast<double>(alone.size()))
        return true;
    grid_.clear();
    grid_.add(grid_.volume_of(cells));
    int people = 0;
    for (const Cells& part : grid_.parts(OccupiedCells::kFree))
        if (is_upright(part))
            for (const Cells& share : split_by_trunks(grid_, part)) people += is_upright(share);
    return people >= 2;
}

Newcomer SceneTracker::lone_newcomer(std::int64_t time_ns) const {
    if (subjects_.size() == 1) return {subjects_[0].id, subjects_[0].found_as, false};
    Newcomer unknown;
    unknown.undecided =
        !pending_.empty() && !views_.empty() && memory_.knows_absent({}, remembered_since_ns(time_ns));
    return unknown;
}

// Decides who of those tracked is followed, and reports changes.
void SceneTracker::follow(std::uint64_t sequence, std::int64_t time_ns, SceneUpdate& update) {
    std::vector<Person> people;
    for (const Subject& subject : subjects_) {
        const Vec3 at = subject.seen ? subject.shape.centre_in_world : subject.filter.centre_in_world();
        people.push_back({subject.id, {at.x, at.y}, subject.followed});
    }
    choose_followed(people, options_.rules, control_ ? control_->requests() : SubjectRequests{},
                    options_.max_subjects);
    for (std::size_t n = 0; n < people.size(); ++n) {
        Subject& subject = subjects_[n];
        const Followed before = std::exchange(subject.followed, people[n].followed);
        if (subject.followed == Followed::kYes && before != Followed::kYes) {
            const std::string how = subject.followed_before ? "followed again" : subject.found_as;
            update.events.push_back(event(EventKind::kSubjectFound, how + " at", subject, sequence, time_ns));
            subject.followed_before = true;
        } else if (subject.followed != Followed::kYes && before == Followed::kYes) {
            const char* const reason = subject.followed == Followed::kOutside   ? "outside of the regions"
                                       : subject.followed == Followed::kIgnored ? "on request"
                                                                                : "others are nearer";
            update.events.push_back(event(EventKind::kSubjectLost,
                                          fmt::format("no longer followed ({}) at", reason), subject,
                                          sequence, time_ns));
        }
    }
}

// Reports who is there, and who may return.
void SceneTracker::publish(std::int64_t time_ns) const {
    if (!control_) return;
    std::vector<KnownSubject> known = absent_subjects(time_ns);
    for (const Subject& subject : subjects_)
        known.push_back({subject.id, "", true, subject.followed, subject.shape.centre_in_world,
                         subject.shape.max_in_world.z, 0});
    std::ranges::sort(known, {}, &KnownSubject::id);
    control_->publish(std::move(known));
}

std::vector<KnownSubject> SceneTracker::absent_subjects(std::int64_t time_ns) const {
    std::vector<KnownSubject> absent;
    for (const RememberedSubject& each : memory_.remembered()) {
        const double absent_s = 1e-9 * static_cast<double>(time_ns - each.last_seen_ns);
        if (absent_s <= options_.recognise_within_s &&
            std::ranges::find(subjects_, each.subject_id, &Subject::id) == subjects_.end())
            absent.push_back(
                {each.subject_id, "", false, Followed::kTooMany, each.last_centre, each.height_m, absent_s});
    }
    return absent;
}

}  // namespace kinevox
