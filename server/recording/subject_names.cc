#include "server/recording/subject_names.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <optional>
#include <span>
#include <system_error>
#include <utility>

#include "common/files.h"
#include "common/one_line.h"
#include "common/session_file.h"
#include "server/recording/csv_tables.h"

namespace kinevox {
namespace {

constexpr double kMaxDistance_m = 0.6;  // of a subject's centre from the recorded joints' mean
constexpr std::string_view kNamesHeader = "subject,name";

// A cell that csv_cell() wrote; nullopt: its quotes are not closed.
std::optional<std::string> unquoted(std::string_view cell) {
    if (!cell.starts_with('"')) return std::string(cell);
    cell.remove_prefix(1);
    std::string text;
    for (std::size_t n = 0; n < cell.size(); ++n) {
        if (cell[n] != '"') {
            text += cell[n];
        } else if (n + 1 == cell.size()) {
            return text;
        } else if (cell[++n] == '"') {
            text += '"';
        } else {
            break;
        }
    }
    return std::nullopt;
}

// Letters, digits and what lies outside ASCII; the rest means something to a shell or a file system.
bool is_plain(char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '-' ||
           static_cast<unsigned char>(c) >= 0x80;
}

std::optional<Vec3> mean_of(std::span<const double> joints) {
    Vec3 sum;
    int count = 0;
    for (std::size_t n = 0; n + 2 < joints.size(); n += 3) {
        if (std::isnan(joints[n])) continue;
        sum = sum + Vec3{joints[n], joints[n + 1], joints[n + 2]};
        ++count;
    }
    if (count == 0) return std::nullopt;
    return (1.0 / count) * sum;
}

}  // namespace

void set_subject_name(SubjectNames& names, std::uint32_t id, const std::string& name) {
    if (name.empty())
        names.erase(id);
    else
        names[id] = name;
}

std::string subject_name(const SubjectNames& names, std::uint32_t id) {
    const auto found = names.find(id);
    return found == names.end() ? std::string() : found->second;
}

std::string common_subject_name(const SubjectNames& names, const std::set<std::uint32_t>& ids) {
    std::set<std::string> distinct;
    for (const std::uint32_t id : ids) distinct.insert(subject_name(names, id));
    return distinct.size() == 1 ? *distinct.begin() : std::string();
}

std::string subject_names_csv(const SubjectNames& names) {
    std::string text = fmt::format("{}\n", kNamesHeader);
    for (const auto& [id, name] : names) text += fmt::format("{},{}\n", id, csv_cell(one_line(name)));
    return text;
}

absl::StatusOr<SubjectNames> read_subject_names(const std::filesystem::path& tables) {
    const std::filesystem::path file = tables / kSubjectNamesFile;
    SubjectNames names;
    if (std::error_code error; !std::filesystem::exists(file, error)) return names;
    const auto text = read_file(file);
    if (!text.ok()) return text.status();
    std::string_view rest = *text;
    for (std::size_t number = 1; !rest.empty(); ++number) {
        std::string_view line = rest.substr(0, rest.find('\n'));
        rest.remove_prefix(std::min(rest.size(), line.size() + 1));
        if (line.ends_with('\r')) line.remove_suffix(1);
        const auto wrong = [&](std::string_view expected) {
            return absl::InvalidArgumentError(
                fmt::format("{}:{}: is '{}', expected {}; correct it", file.string(), number,
                            one_line(std::string(line.substr(0, 40))), expected));
        };
        if (number == 1) {
            if (line != kNamesHeader) return wrong(fmt::format("the header '{}'", kNamesHeader));
            continue;
        }
        std::uint32_t id = 0;
        const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), id);
        const std::string_view cell = line.substr(static_cast<std::size_t>(end - line.data()));
        const auto name = cell.starts_with(',') ? unquoted(cell.substr(1)) : std::nullopt;
        if (error != std::errc() || id == 0 || !name) return wrong("a subject's id and its name");
        set_subject_name(names, id, one_line(*name));
    }
    return names;
}

std::string subject_file_name(std::uint32_t id, std::string_view name) {
    std::string out = fmt::format("s{}", id);
    if (name.empty()) return out;
    out += '_';
    for (const char c : name) out += is_plain(c) ? c : '_';
    return out;
}

absl::StatusOr<RecordedNames> RecordedNames::read(const std::filesystem::path& tables) {
    RecordedNames recorded;
    auto names = read_subject_names(tables);
    if (!names.ok()) return names.status();
    if (names->empty()) return recorded;
    const auto joints = read_csv_table(tables / "joints.csv", joint_columns());
    if (!joints.ok()) return joints.status();
    recorded.names_ = *std::move(names);
    constexpr std::size_t kSubject = 2, kFirstValue = 3;
    for (std::size_t n = 0; n < joints->rows(); ++n) {
        const double frame = joints->at(n, 0), id = joints->at(n, kSubject);
        if (std::isnan(frame) || !(id >= 1 && id <= std::numeric_limits<std::uint32_t>::max())) continue;
        const auto cells = std::span(joints->cells).subspan(n * joints->columns, joints->columns);
        if (const auto centre = mean_of(cells.subspan(kFirstValue)))
            recorded.frames_[static_cast<std::int64_t>(frame)].push_back(
                {static_cast<std::uint32_t>(id), *centre});
    }
    return recorded;
}

absl::StatusOr<RecordedNames> RecordedNames::of_session(const std::filesystem::path& session_file) {
    const auto session = read_session(session_file);
    if (!session.ok() || !session->recording || session->recording->poses.empty()) return RecordedNames();
    return read(session->recording->poses);
}

void RecordedNames::add(std::int64_t frame, std::uint32_t id, const Vec3& centre_in_world) {
    const auto found = frames_.find(frame);
    if (found == frames_.end()) return;
    const Recorded* nearest = nullptr;
    double distance_m = kMaxDistance_m;
    for (const Recorded& recorded : found->second)
        if (const double away_m = norm(recorded.centre_in_world - centre_in_world); away_m < distance_m)
            nearest = &recorded, distance_m = away_m;
    if (nearest) ++votes_[id][nearest->id];
}

std::string RecordedNames::name_of(std::uint32_t id, int min_frames) const {
    const auto votes = votes_.find(id);
    if (votes == votes_.end()) return {};
    const auto most =
        std::ranges::max_element(votes->second, {}, [](const auto& vote) { return vote.second; });
    if (most->second < min_frames) return {};
    return subject_name(names_, most->first);
}

SubjectNames RecordedNames::names() const {
    SubjectNames names;
    for (const auto& [id, votes] : votes_) set_subject_name(names, id, name_of(id));
    return names;
}

}  // namespace kinevox
