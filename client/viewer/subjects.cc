#include "client/viewer/subjects.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace kinevox::viewer {
namespace {

constexpr std::uint32_t kSingle = 0;  // key of the history while one is seen at a time
constexpr auto kPatience_ns = static_cast<std::int64_t>(1e9 * Subjects::kPatience_s);
constexpr double kClickRadius_px = 10;

}  // namespace

const ShownSubject* ShownVolume::subject(std::uint32_t id) const {
    const auto found = std::ranges::find(subjects, id, &ShownSubject::id);
    return found == subjects.end() ? nullptr : &*found;
}

ShownPose ShownPoses::pose(std::uint32_t id) const {
    const auto found = std::ranges::find(subjects, id, &ShownPose::subject_id);
    if (found != subjects.end()) return *found;
    ShownPose none;
    none.subject_id = id;
    none.sequence = sequence;
    none.capture_time_ns = capture_time_ns;
    none.recorded_frame = recorded_frame;
    return none;
}

void Subjects::clear() {
    *this = {};
}

void Subjects::select(std::uint32_t id) {
    if (!several()) return;
    chosen_ = selected_ = id;
}

void Subjects::select_next() {
    const std::vector<std::uint32_t> known = ids();
    if (known.empty()) return;
    const auto next = std::ranges::upper_bound(known, selected_);
    select(next == known.end() ? known.front() : *next);
}

std::vector<std::uint32_t> Subjects::ids() const {
    std::vector<std::uint32_t> known;
    for (const auto& [id, seen_ns] : last_seen_ns_) known.push_back(id);
    return known;
}

std::string Subjects::name_of(std::uint32_t id) const {
    const auto found = names_.find(id);
    return found == names_.end() ? std::string() : found->second;
}

std::optional<std::uint32_t> Subjects::compared() const {
    if (!several() || compared_ == selected_ || !last_seen_ns_.contains(compared_)) return {};
    return compared_;
}

const AngleHistory& Subjects::history(std::uint32_t id) const {
    static const AngleHistory kEmpty;
    const auto found = histories_.find(several() ? id : kSingle);
    return found == histories_.end() ? kEmpty : found->second;
}

void Subjects::add(const ShownPoses& poses) {
    const std::int64_t now_ns = poses.capture_time_ns;
    if (now_ns <= latest_ns_) last_seen_ns_.clear();  // after a seek
    latest_ns_ = now_ns;
    forget(now_ns);
    // Only new ids: tracking was reset, as where a session begins again, and the earlier subjects do not
    // return.
    const auto is_new = [&](const ShownPose& pose) { return pose.subject_id > newest_id_; };
    if (!poses.subjects.empty() && std::ranges::all_of(poses.subjects, is_new)) last_seen_ns_.clear();
    for (const ShownPose& pose : poses.subjects) newest_id_ = std::max(newest_id_, pose.subject_id);
    for (const ShownPose& pose : poses.subjects) last_seen_ns_[pose.subject_id] = now_ns;
    for (const ShownPose& pose : poses.subjects) names_[pose.subject_id] = pose.subject_name;
    std::erase_if(names_, [&](const auto& named) { return !last_seen_ns_.contains(named.first); });
    give_colours();
    if (poses.subjects.size() > 1) {
        if (!several()) {  // the history so far is that of the one who was there
            auto single = histories_.extract(kSingle);
            if (single && selected_ != 0) {
                single.key() = selected_;
                histories_.insert(std::move(single));
            }
        }
        several_until_ns_ = now_ns + kPatience_ns;
    }
    choose(poses);
    add_to_histories(poses);
}

void Subjects::give_colours() {
    std::erase_if(colours_, [&](const auto& given) { return !last_seen_ns_.contains(given.first); });
    for (const auto& [id, seen_ns] : last_seen_ns_) {
        if (colours_.contains(id)) continue;
        std::uint32_t number = (id + kColours - 1) % kColours + 1;
        const auto is_taken = [&](const auto& given) { return given.second == number; };
        for (std::uint32_t n = 0; n < kColours && std::ranges::any_of(colours_, is_taken); ++n)
            number = number % kColours + 1;
        colours_[id] = number;
    }
}

void Subjects::forget(std::int64_t now_ns) {
    std::erase_if(last_seen_ns_, [&](const auto& seen) { return now_ns - seen.second > kPatience_ns; });
    const bool seek = several_until_ns_ && now_ns < *several_until_ns_ - kPatience_ns;
    if (!several_until_ns_ || (now_ns <= *several_until_ns_ && !seek)) return;
    several_until_ns_.reset();
    auto kept = histories_.extract(selected_);
    histories_.clear();
    if (!kept) return;
    kept.key() = kSingle;
    histories_.insert(std::move(kept));
}

void Subjects::choose(const ShownPoses& poses) {
    const auto present = [&](std::uint32_t id) {
        return std::ranges::count(poses.subjects, id, &ShownPose::subject_id) > 0;
    };
    if (present(chosen_) || (several() && last_seen_ns_.contains(chosen_)))
        selected_ = chosen_;
    else if (present(selected_) || (several() && last_seen_ns_.contains(selected_)))
        return;
    else if (!poses.subjects.empty())
        selected_ = poses.subjects.front().subject_id;
}

// All histories have the same instants, so that curves of two subjects have the same time axis.
void Subjects::add_to_histories(const ShownPoses& poses) {
    if (!several()) return histories_[kSingle].add(poses.pose(selected_));
    for (const ShownPose& pose : poses.subjects) histories_.try_emplace(pose.subject_id);
    std::erase_if(histories_, [&](const auto& entry) {
        return entry.first != selected_ && !last_seen_ns_.contains(entry.first);
    });
    for (auto& [id, history] : histories_) history.add(poses.pose(id));
}

std::optional<std::uint32_t> subject_at(const ScenePoint& at, const std::array<double, 16>& m,
                                        const ShownVolume* volume, const ShownPoses* poses) {
    std::optional<std::uint32_t> nearest;
    double nearest_depth = std::numeric_limits<double>::infinity();
    const auto try_point = [&](std::uint32_t id, double x, double y, double z) {
        const double w = m[12] * x + m[13] * y + m[14] * z + m[15];
        if (w <= 0 || w >= nearest_depth) return;
        const double right = (m[0] * x + m[1] * y + m[2] * z + m[3]) / w,
                     up = (m[4] * x + m[5] * y + m[6] * z + m[7]) / w;
        const double dx = (0.5 + 0.5 * right) * at.width_px - at.x_px,
                     dy = (0.5 - 0.5 * up) * at.height_px - at.y_px;
        if (std::hypot(dx, dy) > kClickRadius_px) return;
        nearest = id;
        nearest_depth = w;
    };
    if (volume)
        for (const ShownSubject& subject : volume->subjects)
            for (std::size_t n = 0; n < subject.point_count; ++n) {
                const SurfacePoint& p = volume->points[subject.first_point + n];
                try_point(subject.id, p.x, p.y, p.z);
            }
    if (poses)
        for (const ShownPose& pose : poses->subjects)
            for (const auto& joint : pose.joints_in_world)
                if (joint) try_point(pose.subject_id, joint->x, joint->y, joint->z);
    return nearest;
}

}  // namespace kinevox::viewer
