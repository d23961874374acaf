#include "server/recording/trial.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <set>
#include <span>
#include <type_traits>
#include <utility>

#include "common/geometry.h"
#include "common/median.h"
#include "server/recording/csv_tables.h"
#include "server/recording/subject_names.h"

namespace kinevox {
namespace {

namespace fs = std::filesystem;
constexpr std::size_t kSubject = 2, kFirstValue = 3;  // after frame and time_s; after subject

absl::Status wrong(const CsvTable& table, std::size_t row, const std::string& what) {
    return absl::InvalidArgumentError(
        fmt::format("{}:{}: {}; rerun `kinevox process`", table.file, table.lines[row], what));
}

// One row per frame, of one subject: 0 takes the only one of each frame. A frame without it gets its cells
// empty.
absl::StatusOr<CsvTable> rows_of_subject(const CsvTable& table, std::uint32_t subject_id) {
    CsvTable out{table.file, table.columns, {}, {}};
    for (std::size_t n = 0; n < table.rows(); ++n)
        if (const double id = table.at(n, kSubject);
            !std::isnan(id) &&
            !(id >= 1 && id <= std::numeric_limits<std::uint32_t>::max() && id == std::floor(id)))
            return wrong(table, n, fmt::format("subject is {}, expected a whole number from 1", id));
    const auto same_frame = [&](std::size_t a, std::size_t b) {  // of two subjects
        return table.at(a, 0) == table.at(b, 0) && !std::isnan(table.at(a, kSubject) + table.at(b, kSubject));
    };
    std::set<std::uint32_t> several;
    for (std::size_t begin = 0, end = 0; begin < table.rows(); begin = end) {
        while (end < table.rows() && (end == begin || same_frame(begin, end))) ++end;
        for (std::size_t n = begin + 1; n < end; ++n)
            if (table.at(n, kSubject) == table.at(n - 1, kSubject))
                return wrong(
                    table, n,
                    fmt::format("frame {} has subject {} twice", table.at(n, 0), table.at(n, kSubject)));
        std::size_t row = begin;
        while (row < end && subject_id != 0 && table.at(row, kSubject) != subject_id) ++row;
        if (subject_id == 0 && end - begin > 1)
            for (std::size_t n = begin; n < end; ++n)
                several.insert(static_cast<std::uint32_t>(table.at(n, kSubject)));
        const auto first =
            table.cells.begin() + static_cast<std::ptrdiff_t>((row < end ? row : begin) * table.columns);
        out.cells.insert(out.cells.end(), first, first + static_cast<std::ptrdiff_t>(table.columns));
        if (row == end)
            std::fill(out.cells.end() - static_cast<std::ptrdiff_t>(table.columns - kSubject),
                      out.cells.end(), std::numeric_limits<double>::quiet_NaN());
        out.lines.push_back(table.lines[row < end ? row : begin]);
    }
    if (!several.empty())
        return absl::FailedPreconditionError(
            fmt::format("{}: holds subjects {}; choose one of them", table.file, fmt::join(several, ", ")));
    return out;
}

absl::Status take_frames(const CsvTable& table, Trial& trial) {
    for (std::size_t n = 0; n < table.rows(); ++n) {
        const double frame = table.at(n, 0), time_s = table.at(n, 1);
        if (!(frame >= 0 && frame < 1e15 && frame == std::floor(frame)))
            return wrong(table, n, fmt::format("frame is {}, expected a whole number from 0", frame));
        if (std::isnan(time_s)) return wrong(table, n, "time_s is missing");
        if (n > 0 && frame != static_cast<double>(trial.frames.back()) + 1)
            return wrong(table, n, fmt::format("frame {} follows frame {}", frame, trial.frames.back()));
        trial.frames.push_back(static_cast<std::int64_t>(frame));
        trial.time_s.push_back(time_s);
    }
    trial.session_frames = trial.frames;
    if (trial.size() < 2)
        return absl::InvalidArgumentError(
            fmt::format("{}: {} frames; a trial needs at least two", table.file, trial.size()));
    return absl::OkStatus();
}

// Frames and rate for a given frame period; true if each row is within `tolerance` of a frame of its own.
bool take_step(double step_s, double tolerance, Trial& trial) {
    const double start_s = trial.time_s.front();
    for (std::size_t n = 1; n < trial.size(); ++n)
        trial.frames[n] =
            trial.frames[n - 1] +
            std::max<std::int64_t>(1, std::llround((trial.time_s[n] - trial.time_s[n - 1]) / step_s));
    const double rate_hz =
        static_cast<double>(trial.frames.back() - trial.frames.front()) / (trial.time_s.back() - start_s);
    trial.rate_hz = std::max(std::round(1000 * rate_hz) / 1000, 0.001);
    for (std::size_t n = 0; n < trial.size(); ++n) {
        const double even_s = start_s + static_cast<double>(trial.frames[n] - trial.frames.front()) / rate_hz;
        if (std::abs(trial.time_s[n] - even_s) > tolerance / rate_hz) return false;
    }
    return true;
}

// Frames by the nearest grid point of a given frame period; true if each row has one within a frame.
bool take_nearest(double step_s, Trial& trial) {
    double max_snap_frames = 0;
    for (std::size_t n = 1; n < trial.size(); ++n) {
        const double frames = (trial.time_s[n] - trial.time_s.front()) / step_s;
        trial.frames[n] =
            std::max<std::int64_t>(trial.frames[n - 1] + 1, trial.frames.front() + std::llround(frames));
        const double snap = std::abs(static_cast<double>(trial.frames[n] - trial.frames.front()) - frames);
        if (snap > 1) return false;
        max_snap_frames = std::max(max_snap_frames, snap);
    }
    trial.rate_hz = std::max(std::round(1000 / step_s) / 1000, 0.001);
    trial.max_time_snap_s = max_snap_frames * step_s;
    return true;
}

// The median of the shortest step and those near it: the steps of one frame.
double min_step_s(std::vector<double>& steps_s) {
    std::ranges::sort(steps_s);
    const auto end = std::ranges::upper_bound(steps_s, 1.5 * steps_s.front());
    return steps_s[static_cast<std::size_t>(end - steps_s.begin()) / 2];
}

// Times are written to the microsecond. Lost frame sets make steps of several frames, which trial.frames
// counts; they may be half of the steps or more, so that the median is a few frames. A source that lagged may
// restart its timing between two frames: no even grid fits then, and times snap to the nearest frame. The
// times take precedence over the session's rate, which a camera may not keep.
bool take_steps(std::vector<double> steps_s, double fps, Trial& trial) {
    constexpr int kMaxFramesInMedian = 6;
    const double median_s = median_of(steps_s);
    if (take_step(median_s, 0.2, trial)) return true;
    if (fps > 0 && (take_step(1 / fps, 0.5, trial) || take_nearest(1 / fps, trial))) return true;
    if (take_step(median_s, 0.5, trial)) return true;
    for (int frames = 2; frames <= kMaxFramesInMedian; ++frames)
        if (take_step(median_s / frames, 0.2, trial)) return true;
    return take_nearest(min_step_s(steps_s), trial);
}

// The rate, to a thousandth of a hertz, and the frames of the times. `fps`: the session's, 0 if not known.
absl::Status take_rate(const CsvTable& table, double fps, Trial& trial) {
    constexpr double kMaxGap_s = 3600;
    // Half a kilobyte each; a million are over four hours at 60 per second.
    const std::int64_t max_frames =
        std::max<std::int64_t>(1'000'000, 4 * static_cast<std::int64_t>(trial.size()));
    std::vector<double> steps_s;
    for (std::size_t n = 1; n < trial.size(); ++n) {
        const double step_s = trial.time_s[n] - trial.time_s[n - 1];
        if (!(step_s > 1e-6 && step_s < kMaxGap_s))
            return wrong(table, n,
                         fmt::format("time_s is {:.4f} after {:.4f}", trial.time_s[n], trial.time_s[n - 1]));
        steps_s.push_back(step_s);
    }
    if (!take_steps(std::move(steps_s), fps, trial))
        return wrong(table, trial.size() - 1, "the times fit no frame rate");
    const std::int64_t frames = trial.frames.back() - trial.frames.front() + 1;
    if (frames > max_frames)
        return wrong(table, trial.size() - 1,
                     fmt::format("{} frames including lost ones, expected at most {}", frames, max_frames));
    return absl::OkStatus();
}

// Adds rows without values for lost frame sets.
void fill_gaps(Trial& trial) {
    const std::int64_t first = trial.frames.front();
    const auto size = static_cast<std::size_t>(trial.frames.back() - first + 1);
    if (size == trial.size()) return;
    constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
    const auto spread = [&](auto& values, const auto& missing) {
        if (values.empty()) return;
        std::decay_t<decltype(values)> spaced(size, missing);
        for (std::size_t n = 0; n < values.size(); ++n)
            spaced[static_cast<std::size_t>(trial.frames[n] - first)] = values[n];
        values = std::move(spaced);
    };
    std::array<Vec3, kJointNames.size()> no_joints;
    no_joints.fill({kNone, kNone, kNone});
    std::array<double, kJointAngleNames.size()> no_angles;
    no_angles.fill(kNone);
    BodyCoordinates no_coordinates;
    no_coordinates.fill(kNone);
    spread(trial.joints, no_joints);
    spread(trial.angles_rad, no_angles);
    spread(trial.coordinates, no_coordinates);
    spread(trial.session_frames, std::int64_t{-1});
    const double start_s = trial.time_s.front();
    trial.frames.resize(size);
    trial.time_s.resize(size);
    for (std::size_t n = 0; n < size; ++n) {
        trial.frames[n] = first + static_cast<std::int64_t>(n);
        trial.time_s[n] = start_s + static_cast<double>(n) / trial.rate_hz;
    }
}

absl::Status take_joints(const CsvTable& table, Trial& trial) {
    bool any = false;
    trial.joints.resize(trial.size());
    for (std::size_t n = 0; n < trial.size(); ++n)
        for (std::size_t j = 0; j < kJointNames.size(); ++j) {
            const double* const p = &table.cells[n * table.columns + kFirstValue + 3 * j];
            const int missing = std::isnan(p[0]) + std::isnan(p[1]) + std::isnan(p[2]);
            if (missing != 0 && missing != 3)
                return wrong(table, n, fmt::format("{} lacks some of x, y, z", kJointNames[j]));
            any = any || missing == 0;
            trial.joints[n][j] = {p[0], p[1], p[2]};
        }
    if (!any)
        return absl::InvalidArgumentError(fmt::format(
            "{}: no joint was measured in any frame; see withheld.csv for the reasons", table.file));
    return absl::OkStatus();
}

// Of the subject; of all rows, if all subjects in them have the same one.
absl::StatusOr<std::string> read_subject_name(const fs::path& folder, const CsvTable& all,
                                              std::uint32_t subject_id) {
    const auto names = read_subject_names(folder);
    if (!names.ok()) return names.status();
    if (subject_id != 0) return subject_name(*names, subject_id);
    std::set<std::uint32_t> ids;
    for (std::size_t n = 0; n < all.rows() && !names->empty(); ++n)
        if (const double id = all.at(n, kSubject); !std::isnan(id))
            ids.insert(static_cast<std::uint32_t>(id));
    return common_subject_name(*names, ids);
}

// A table with the same frames as joints.csv.
absl::StatusOr<CsvTable> read_table(const fs::path& file, std::span<const std::string> columns,
                                    const Trial& trial, std::uint32_t subject_id) {
    auto all = read_csv_table(file, columns);
    if (!all.ok()) return all;
    auto table = rows_of_subject(*all, subject_id);
    if (!table.ok()) return table;
    for (std::size_t n = 0; n < std::min(table->rows(), trial.size()); ++n)
        if (table->at(n, 0) != static_cast<double>(trial.session_frames[n]))
            return wrong(
                *table, n,
                fmt::format("frame is {}, but {} in joints.csv", table->at(n, 0), trial.session_frames[n]));
    if (table->rows() != trial.size())
        return absl::InvalidArgumentError(
            fmt::format("{}: {} frames, but joints.csv has {}; both must be from one run", table->file,
                        table->rows(), trial.size()));
    return table;
}

}  // namespace

absl::StatusOr<Trial> read_trial(const fs::path& folder, double fps, std::uint32_t subject_id) {
    std::error_code error;
    if (!fs::is_directory(folder, error))
        return absl::NotFoundError(
            fmt::format("{}: no such folder; give the folder that `kinevox process` wrote", folder.string()));
    Trial trial;
    trial.folder = folder;
    trial.subject_id = subject_id;
    const fs::path absolute = fs::absolute(folder, error).lexically_normal();
    trial.name = (absolute.has_filename() ? absolute : absolute.parent_path()).filename().string();
    if (!fs::exists(folder / "joints.csv", error))
        return absl::NotFoundError(
            fmt::format("{}: no such file; give a folder with poses that `kinevox process` wrote",
                        (folder / "joints.csv").string()));
    const auto rows = read_csv_table(folder / "joints.csv", joint_columns());
    if (!rows.ok()) return rows.status();
    const auto joints = rows_of_subject(*rows, subject_id);
    if (!joints.ok()) return joints.status();
    absl::Status taken = take_frames(*joints, trial);
    if (taken.ok()) taken = take_rate(*joints, fps, trial);
    if (taken.ok()) taken = take_joints(*joints, trial);
    if (!taken.ok()) return taken;
    auto name = read_subject_name(folder, *rows, subject_id);
    if (!name.ok()) return name.status();
    trial.subject_name = *std::move(name);

    if (fs::exists(folder / "angles.csv", error)) {
        auto angles = read_table(folder / "angles.csv", angle_columns(), trial, subject_id);
        if (!angles.ok()) return angles.status();
        trial.angles_rad.resize(trial.size());
        for (std::size_t n = 0; n < trial.size(); ++n)
            for (std::size_t k = 0; k < kJointAngleNames.size(); ++k)
                trial.angles_rad[n][k] = radians(angles->at(n, kFirstValue + k));
    }
    if (fs::exists(folder / "coordinates.csv", error)) {
        auto table = read_table(folder / "coordinates.csv", coordinate_columns(), trial, subject_id);
        if (!table.ok()) return table.status();
        trial.coordinates.resize(trial.size());
        for (std::size_t n = 0; n < trial.size(); ++n)
            for (int d = 0; d < kBodyDofCount; ++d) {
                const double value = table->at(n, kFirstValue + d);
                trial.coordinates[n][d] = is_position(d) ? value : radians(value);
            }
    }
    fs::path body_file = folder / fmt::format("body_{}.toml", subject_id);
    if (subject_id == 0 || !fs::exists(body_file, error)) body_file = folder / "body.toml";
    if (fs::exists(body_file, error)) {
        auto body = read_body_shape(body_file);
        if (!body.ok()) return body.status();
        trial.body = *body;
    }
    fill_gaps(trial);
    return trial;
}

absl::StatusOr<TrialSubjects> subjects_of_trial(const fs::path& folder) {
    const auto table = read_csv_table(folder / "joints.csv", joint_columns());
    if (!table.ok()) return table.status();
    TrialSubjects subjects;
    std::set<std::uint32_t> measured;
    int in_frame = 0;
    for (std::size_t n = 0; n < table->rows(); ++n) {
        const double id = table->at(n, kSubject);
        if (std::isnan(id)) continue;
        in_frame = n > 0 && table->at(n, 0) == table->at(n - 1, 0) ? in_frame + 1 : 1;
        subjects.max_at_once = std::max(subjects.max_at_once, in_frame);
        const auto cells = std::span(table->cells).subspan(n * table->columns, table->columns);
        if (std::ranges::any_of(cells.subspan(kFirstValue), [](double cell) { return !std::isnan(cell); }))
            measured.insert(static_cast<std::uint32_t>(id));
    }
    subjects.ids.assign(measured.begin(), measured.end());
    return subjects;
}

absl::StatusOr<std::vector<Trial>> read_trials(const fs::path& folder, double fps,
                                               const TrialSubjects& subjects) {
    std::vector<std::uint32_t> ids = subjects.ids;
    if (subjects.max_at_once < 2 || ids.empty()) ids = {0};
    std::vector<Trial> trials;
    for (const std::uint32_t id : ids) {
        auto trial = read_trial(folder, fps, id);
        if (!trial.ok()) return trial.status();
        trials.push_back(*std::move(trial));
    }
    return trials;
}

absl::Status needs_coordinates_and_body(const Trial& trial, std::string_view format) {
    const char* missing = trial.coordinates.empty() ? "coordinates.csv" : trial.body ? nullptr : "body.toml";
    if (!missing) return absl::OkStatus();
    return absl::FailedPreconditionError(
        fmt::format("{}: no such file, which {} needs; `kinevox process` writes it",
                    (trial.folder / missing).string(), format));
}

absl::StatusOr<Trial> slice_trial(const Trial& trial, std::int64_t first_frame, std::int64_t last_frame) {
    const std::int64_t begin = std::max<std::int64_t>(first_frame - trial.frames.front(), 0);
    const std::int64_t end = std::min<std::int64_t>(last_frame - trial.frames.front() + 1,
                                                    static_cast<std::int64_t>(trial.size()));
    if (end - begin < 2)
        return absl::OutOfRangeError(fmt::format(
            "{}: frames {} to {} are not at least two of {} to {}; change the range", trial.folder.string(),
            first_frame, last_frame, trial.frames.front(), trial.frames.back()));
    const auto cut = [&](auto& values) {
        if (values.empty()) return;
        values.erase(values.begin() + end, values.end());
        values.erase(values.begin(), values.begin() + begin);
    };
    Trial slice = trial;
    cut(slice.frames);
    cut(slice.session_frames);
    cut(slice.time_s);
    cut(slice.joints);
    cut(slice.angles_rad);
    cut(slice.coordinates);
    return slice;
}

void rotate_trial(Trial& trial, double yaw_rad) {
    const Mat3 rotation = rotation_z(yaw_rad);
    for (auto& joints : trial.joints)
        for (Vec3& joint : joints) joint = rotation * joint;
    for (BodyCoordinates& q : trial.coordinates) {
        const Vec3 root = rotation * Vec3{q[0], q[1], q[2]};
        q[0] = root.x, q[1] = root.y, q[2] = root.z;
        // The pelvis' rotation about the world's vertical is its outermost.
        q[kDofRootRotation + 2] = std::remainder(q[kDofRootRotation + 2] + yaw_rad, 2 * std::numbers::pi);
    }
}

}  // namespace kinevox
