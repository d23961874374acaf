#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "client/viewer/ghost_match.h"
#include "common/body_pose.h"

namespace kinevox::viewer {
namespace {

constexpr double kMaxStance_m_per_s = 0.5,
                 kMinSwing_m_per_s = 1.0;  // a foot on the floor, one in the air; horizontally
constexpr double kMaxStanceHeight_m = 0.05,
                 kMinSwingHeight_m = 0.08;  // above the lowest position of the foot
constexpr double kFloorQuantile = 0.05;     // of the foot heights, robust against single wrong frames
constexpr double kMaxDuration_s = 1e7;
constexpr std::size_t kCells = 3 * kJointNames.size();

std::vector<std::string_view> split(std::string_view line) {
    if (line.ends_with('\r')) line.remove_suffix(1);
    std::vector<std::string_view> cells;
    for (;;) {
        const std::size_t comma = line.find(',');
        cells.push_back(line.substr(0, comma));
        if (comma == std::string_view::npos) return cells;
        line.remove_prefix(comma + 1);
    }
}

std::optional<double> number(std::string_view cell) {
    double value = 0;
    const auto [end, error] = std::from_chars(cell.data(), cell.data() + cell.size(), value);
    if (error != std::errc() || end != cell.data() + cell.size() || !std::isfinite(value)) return {};
    return value;
}

// Indices of the columns: time_s, and x, y, z of each joint.
struct Columns {
    std::size_t time = 0, count = 0;
    std::array<std::size_t, kCells> cells{};
};

absl::StatusOr<Columns> find_columns(std::string_view header, const std::string& name) {
    const std::vector<std::string_view> names = split(header);
    const auto position = [&](const std::string& column) {
        return std::ranges::find(names, column) - names.begin();
    };
    Columns columns;
    columns.count = names.size();
    const auto missing = [&](const std::string& column) {
        return absl::InvalidArgumentError(
            fmt::format("{}: no column {}; use joints.csv of `kinevox process` or of `kinevox export "
                        "--format csv`",
                        name, column));
    };
    const auto index = [&](const std::string& column) { return static_cast<std::size_t>(position(column)); };
    columns.time = index("time_s");
    if (columns.time == names.size()) return missing("time_s");
    for (std::size_t n = 0; n < kCells; ++n) {
        const std::string column = fmt::format("{}_{}", kJointNames[n / 3], "xyz"[n % 3]);
        columns.cells[n] = std::min(index(column), index(column + "_m"));
        if (columns.cells[n] == names.size()) return missing(column);
    }
    return columns;
}

// Height and horizontal speed of a foot at each instant; empty where the foot is withheld.
struct Foot {
    double height_m = 0, speed_m_per_s = 0;
};
std::vector<std::optional<Foot>> follow_foot(const std::vector<GhostInstant>& instants, std::size_t joint) {
    std::vector<std::optional<Foot>> feet(instants.size());
    for (std::size_t n = 1; n + 1 < instants.size(); ++n) {
        const auto &before = instants[n - 1].joints_in_world[joint],
                   &now = instants[n].joints_in_world[joint], &after = instants[n + 1].joints_in_world[joint];
        if (!before || !now || !after) continue;
        const Vec3 displacement = *after - *before;
        feet[n] = Foot{now->z, std::hypot(displacement.x, displacement.y) /
                                   (instants[n + 1].time_s - instants[n - 1].time_s)};
    }
    return feet;
}

// The first time at which a foot that was in the air rests on the floor.
std::optional<double> foot_down(const std::vector<GhostInstant>& instants, std::size_t joint) {
    const std::vector<std::optional<Foot>> feet = follow_foot(instants, joint);
    std::vector<double> heights;
    for (const auto& foot : feet)
        if (foot) heights.push_back(foot->height_m);
    if (heights.empty()) return {};
    const auto lowest =
        heights.begin() + static_cast<std::ptrdiff_t>(kFloorQuantile * static_cast<double>(heights.size()));
    std::nth_element(heights.begin(), lowest, heights.end());
    bool in_air = false;
    for (std::size_t n = 0; n < feet.size(); ++n) {
        if (!feet[n]) continue;
        const double above_m = feet[n]->height_m - *lowest;
        if (in_air && above_m < kMaxStanceHeight_m && feet[n]->speed_m_per_s < kMaxStance_m_per_s)
            return instants[n].time_s;
        if (above_m > kMinSwingHeight_m || feet[n]->speed_m_per_s > kMinSwing_m_per_s) in_air = true;
    }
    return {};
}

}  // namespace

std::optional<double> GhostTrial::time_of(TrialEvent event) const {
    if (instants.empty()) return {};
    switch (event) {
        case TrialEvent::kBegin:
            return instants.front().time_s;
        case TrialEvent::kLeftFootDown:
            return foot_down(instants, *joint_index("ankle_l"));
        case TrialEvent::kRightFootDown:
            return foot_down(instants, *joint_index("ankle_r"));
        case TrialEvent::kMark:
            return {};
        case TrialEvent::kHighestPoint:
        case TrialEvent::kLowestPoint:
            break;
    }
    const std::size_t root = *joint_index("root");
    const double sign = event == TrialEvent::kHighestPoint ? 1 : -1;
    const GhostInstant* best = nullptr;
    for (const GhostInstant& instant : instants)
        if (const auto& at = instant.joints_in_world[root];
            at && (!best || sign * at->z > sign * best->joints_in_world[root]->z))
            best = &instant;
    return best ? std::optional(best->time_s) : std::nullopt;
}

std::optional<GhostJoints> GhostTrial::at(double time_s) const {
    if (instants.empty() || time_s < instants.front().time_s || time_s > instants.back().time_s) return {};
    const auto after = std::ranges::lower_bound(instants, time_s, {}, &GhostInstant::time_s);
    if (after == instants.begin()) return after->joints_in_world;
    const GhostInstant &a = *(after - 1), &b = *after;
    const double fraction = (time_s - a.time_s) / (b.time_s - a.time_s);
    GhostJoints joints;
    for (std::size_t j = 0; j < joints.size(); ++j)
        if (a.joints_in_world[j] && b.joints_in_world[j])
            joints[j] = *a.joints_in_world[j] + (*b.joints_in_world[j] - *a.joints_in_world[j]) * fraction;
        else if (const auto& nearer = fraction < 0.5 ? a.joints_in_world[j] : b.joints_in_world[j])
            joints[j] = nearer;
    return joints;
}

absl::StatusOr<GhostTrial> parse_ghost_trial(std::string_view csv, const std::string& name) {
    GhostTrial trial{name, {}};
    std::optional<Columns> columns;
    double first_s = 0;
    for (int line = 1; !csv.empty(); ++line) {
        const std::size_t end = csv.find('\n');
        const std::string_view text = csv.substr(0, end);
        csv.remove_prefix(end == std::string_view::npos ? csv.size() : end + 1);
        if (!columns) {
            auto found = find_columns(text, name);
            if (!found.ok()) return found.status();
            columns = *found;
            continue;
        }
        const std::vector<std::string_view> cells = split(text);
        const auto line_error = [&](std::string_view what) {
            return absl::InvalidArgumentError(
                fmt::format("{}, line {}: {}; export the trial again", name, line, what));
        };
        if (cells.size() != columns->count)
            return line_error(fmt::format("{} cells instead of {}", cells.size(), columns->count));
        const auto parsed_s = number(cells[columns->time]);
        if (parsed_s && trial.instants.empty()) first_s = *parsed_s;
        const double time_s = parsed_s.value_or(0) - first_s;
        if (!parsed_s || !(time_s < kMaxDuration_s) ||
            (!trial.instants.empty() && !(time_s > trial.instants.back().time_s)))
            return line_error(fmt::format("time_s '{}' does not increase", cells[columns->time]));
        GhostInstant instant{time_s, {}};
        for (std::size_t j = 0; j < kJointNames.size(); ++j) {
            const auto x = number(cells[columns->cells[3 * j]]), y = number(cells[columns->cells[3 * j + 1]]),
                       z = number(cells[columns->cells[3 * j + 2]]);
            if (x && y && z) instant.joints_in_world[j] = Vec3{*x, *y, *z};  // withheld cells are empty
        }
        trial.instants.push_back(instant);
    }
    if (trial.instants.size() < 2)
        return absl::InvalidArgumentError(fmt::format("{}: fewer than two frames; use a longer trial", name));
    return trial;
}

}  // namespace kinevox::viewer
