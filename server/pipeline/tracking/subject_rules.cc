#include "server/pipeline/tracking/subject_rules.h"

#include <fmt/format.h>

#include <cmath>
#include <limits>

namespace kinevox {
namespace {

// A centre sways and is noisy, so that a followed person may go this far beyond a border, and another one
// must be this much nearer.
constexpr double kBorder_m = 0.15, kNearer_m = 0.4;
constexpr double kMaxCoordinate_m = 1000, kMinArea_m2 = 0.01;

double distance_to_edge(Vec2 p, Vec2 a, Vec2 b) {
    const double dx = b.x - a.x, dy = b.y - a.y, length2 = dx * dx + dy * dy;
    const double along =
        length2 > 0 ? std::clamp(((p.x - a.x) * dx + (p.y - a.y) * dy) / length2, 0.0, 1.0) : 0;
    return std::hypot(p.x - a.x - along * dx, p.y - a.y - along * dy);
}

double turn(Vec2 a, Vec2 b, Vec2 c) {
    return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

bool cross(Vec2 a, Vec2 b, Vec2 c, Vec2 d) {
    return turn(a, b, c) * turn(a, b, d) < 0 && turn(c, d, a) * turn(c, d, b) < 0;
}

}  // namespace

bool FloorRegion::contains(Vec2 p) const {
    bool inside = false;
    for (std::size_t k = 0, before = corners.size() - 1; k < corners.size(); before = k++) {
        const Vec2 a = corners[k], b = corners[before];
        if ((a.y > p.y) != (b.y > p.y) && p.x < (b.x - a.x) * (p.y - a.y) / (b.y - a.y) + a.x)
            inside = !inside;
    }
    return inside;
}

double FloorRegion::distance_m(Vec2 point) const {
    double nearest = std::numeric_limits<double>::infinity();
    for (std::size_t k = 0, before = corners.size() - 1; k < corners.size(); before = k++)
        nearest = std::min(nearest, distance_to_edge(point, corners[before], corners[k]));
    return contains(point) ? -nearest : nearest;
}

std::string FloorRegion::check() const {
    if (corners.size() < 3) return fmt::format("has {} corners; a region needs at least 3", corners.size());
    double area = 0;
    for (std::size_t k = 0, before = corners.size() - 1; k < corners.size(); before = k++) {
        const Vec2 a = corners[before], b = corners[k];
        if (!(std::abs(b.x) <= kMaxCoordinate_m && std::abs(b.y) <= kMaxCoordinate_m))
            return fmt::format("has the corner ({}, {}) m; coordinates are -{} to {}", b.x, b.y,
                               kMaxCoordinate_m, kMaxCoordinate_m);
        area += (a.x * b.y - a.y * b.x) / 2;
    }
    for (std::size_t k = 0; k < corners.size(); ++k)
        for (std::size_t j = k + 1; j < corners.size(); ++j)
            if (cross(corners[k], corners[(k + 1) % corners.size()], corners[j],
                      corners[(j + 1) % corners.size()]))
                return "has edges that cross; list the corners in order around the region";
    if (std::abs(area) < kMinArea_m2) return "has no area; list at least 3 corners that are not on one line";
    return {};
}

double SubjectRules::margin_m(Vec2 at) const {
    double capture = std::numeric_limits<double>::infinity();
    if (!capture_regions.empty()) {
        capture = -capture;
        for (const FloorRegion& region : capture_regions) capture = std::max(capture, -region.distance_m(at));
    }
    for (const FloorRegion& region : keep_out_regions) capture = std::min(capture, region.distance_m(at));
    return capture;
}

std::string SubjectRules::check() const {
    for (const FloorRegion& region : capture_regions)
        if (std::string problem = region.check(); !problem.empty()) return "a capture region " + problem;
    for (const FloorRegion& region : keep_out_regions)
        if (std::string problem = region.check(); !problem.empty()) return "a keep-out region " + problem;
    return {};
}

void choose_followed(std::span<Person> people, const SubjectRules& rules, const SubjectRequests& requests,
                     int max_subjects) {
    struct Candidate {
        Person* person;
        double rank;  // the smaller ones are followed
    };
    std::vector<Candidate> candidates;
    for (Person& person : people) {
        const bool before = person.followed == Followed::kYes;
        person.followed = Followed::kTooMany;
        if (!requests.only.empty() ? !has_id(requests.only, person.id)
                                   : has_id(requests.ignored, person.id)) {
            person.followed = Followed::kIgnored;
            continue;
        }
        if (requests.only.empty() && !(rules.margin_m(person.on_floor) >= (before ? -kBorder_m : 0))) {
            person.followed = Followed::kOutside;
            continue;
        }
        double rank = before ? -1 : 0;
        if (rules.follow == SubjectRules::Follow::kNearest)
            rank = std::hypot(person.on_floor.x - rules.point.x, person.on_floor.y - rules.point.y) -
                   (before ? kNearer_m : 0);
        candidates.push_back({&person, rank});
    }
    std::ranges::stable_sort(candidates, {}, &Candidate::rank);
    for (std::size_t n = 0; n < candidates.size() && n < static_cast<std::size_t>(max_subjects); ++n)
        candidates[n].person->followed = Followed::kYes;
}

}  // namespace kinevox
