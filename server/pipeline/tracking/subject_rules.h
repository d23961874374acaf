// Which of the people in the scene are followed: by regions on the floor, by the number of subjects, and by
// an operator's requests.
#pragma once

#include <algorithm>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "common/geometry.h"

namespace kinevox {

// A polygon on the floor: corners in order, m, world; at least three, without crossing edges.
struct FloorRegion {
    std::vector<Vec2> corners;

    bool contains(Vec2 point) const;
    // To the nearest edge, m; negative inside.
    double distance_m(Vec2 point) const;
    // Empty when usable, else one sentence.
    std::string check() const;
    bool operator==(const FloorRegion&) const = default;
};

struct SubjectRules {
    enum class Follow {
        kFirst,    // those who came first
        kNearest,  // those nearest to `point`
    };
    Follow follow = Follow::kFirst;
    Vec2 point;                                // m, on the floor
    std::vector<FloorRegion> capture_regions;  // people outside of all are not followed; empty: everywhere
    std::vector<FloorRegion> keep_out_regions;

    // How far from the regions' nearest border a point is on the side where people are followed, m; negative
    // on the other side.
    double margin_m(Vec2 point) const;
    // Empty when usable, else one sentence.
    std::string check() const;
    bool operator==(const SubjectRules&) const = default;
};

// What an operator asked for.
struct SubjectRequests {
    std::vector<std::uint32_t> only;     // only these are followed; empty: the rules decide
    std::vector<std::uint32_t> ignored;  // not followed
    bool operator==(const SubjectRequests&) const = default;
};

inline bool has_id(std::span<const std::uint32_t> ids, std::uint32_t id) {
    return std::ranges::find(ids, id) != ids.end();
}

enum class Followed : std::uint8_t {
    kYes,
    kOutside,  // of the capture region, or in a keep-out region
    kIgnored,  // on request
    kTooMany,  // more people than max_subjects
};

struct Person {
    std::uint32_t id = 0;
    Vec2 on_floor;                           // centre, m
    Followed followed = Followed::kTooMany;  // before; kTooMany for a new one
};

// Decides who is followed, at most `max_subjects`. `people` in the order of their ids. Who is followed
// already stays so at a border or if another is only a little nearer.
void choose_followed(std::span<Person> people, const SubjectRules& rules, const SubjectRequests& requests,
                     int max_subjects);

}  // namespace kinevox
