#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <string_view>
#include <utility>

#include "common/files.h"
#include "common/session_file.h"

namespace kinevox {
namespace {

std::string_view trimmed(std::string_view text) {
    const std::size_t begin = text.find_first_not_of(" \t\r\n");
    return begin == std::string_view::npos ? std::string_view()
                                           : text.substr(begin, text.find_last_not_of(" \t\r\n") - begin + 1);
}

// Whether the line sets that key.
bool sets_key(std::string_view line, std::string_view key) {
    line = trimmed(line);
    return line.starts_with(key) && trimmed(line.substr(key.size())).starts_with('=');
}

std::vector<std::string> lines_of(const std::string& text) {
    std::vector<std::string> lines;
    for (std::size_t at = 0; at < text.size();) {
        const std::size_t end = std::min(text.find('\n', at), text.size() - 1) + 1;
        lines.push_back(text.substr(at, end - at));
        at = end;
    }
    return lines;
}

std::string offset_text(double offset_s) {
    return fmt::format("{:.6f}", offset_s == 0 ? 0.0 : offset_s);  // not -0
}

bool same_but_offsets(const Session& a, const Session& b) {
    const auto same_camera = [](const SessionCamera& x, const SessionCamera& y) {
        return x.name == y.name && x.video == y.video && x.background == y.background;
    };
    return a.name == b.name && a.fps == b.fps && a.calibration == b.calibration && a.truth == b.truth &&
           std::ranges::equal(a.cameras, b.cameras, same_camera);
}

}  // namespace

bool has_offsets(const Session& session) {
    return std::ranges::any_of(session.cameras,
                               [](const SessionCamera& camera) { return camera.offset_s.has_value(); });
}

std::vector<std::int64_t> first_image_indices(const Session& session) {
    const std::size_t count = session.cameras.size();
    std::vector<double> full(count), fraction(count), sorted;  // of each camera's begin, in frames
    for (std::size_t c = 0; c < count; ++c) {
        const double begin = session.cameras[c].offset_s.value_or(0) * session.fps;
        full[c] = std::floor(begin);
        fraction[c] = begin - full[c];
    }
    // Frame sets are cut where the widest gap between the cameras' images is.
    sorted = fraction;
    std::ranges::sort(sorted);
    double widest = sorted.empty() ? 0 : sorted.front() + 1 - sorted.back(), cut = -1;
    for (std::size_t i = 0; i + 1 < count; ++i)
        if (sorted[i + 1] - sorted[i] > widest) widest = sorted[i + 1] - sorted[i], cut = sorted[i];
    double last_begin = std::numeric_limits<double>::lowest();
    for (std::size_t c = 0; c < count; ++c) {
        if (fraction[c] <= cut) full[c] -= 1;
        last_begin = std::max(last_begin, full[c]);
    }
    std::vector<std::int64_t> first(count);
    for (std::size_t c = 0; c < count; ++c) first[c] = std::llround(last_begin - full[c]);
    return first;
}

absl::StatusOr<std::int64_t> common_length(const Session& session, std::span<const std::int64_t> images) {
    const std::vector<std::int64_t> first = first_image_indices(session);
    std::int64_t length = std::numeric_limits<std::int64_t>::max();
    std::size_t ends = 0;
    for (std::size_t c = 0; c < first.size(); ++c)
        if (images[c] - first[c] < length) length = images[c] - first[c], ends = c;
    if (length > 0) return length;
    const std::size_t begins = static_cast<std::size_t>(std::ranges::min_element(first) - first.begin());
    return absl::InvalidArgumentError(fmt::format(
        "session \"{}\": camera {} begins when camera {} has ended, so that no frame set is left; "
        "correct their offset_s, or "
        "find them with kinevox sync",
        session.name, session.cameras[begins].name, session.cameras[ends].name));
}

absl::StatusOr<std::string> with_offsets(const std::string& text, std::span<const double> offsets_s) {
    const auto unknown = [] {
        return absl::InvalidArgumentError(
            "the session's cameras are not written as [[camera]] with one key a line");
    };
    std::vector<std::string> lines = lines_of(text);
    std::string out;
    std::size_t cameras = 0;
    for (std::size_t i = 0; i < lines.size();) {
        if (!trimmed(lines[i]).starts_with("[[camera]]")) {
            out += lines[i++];
            continue;
        }
        if (cameras == offsets_s.size()) return unknown();
        const std::string offset = offset_text(offsets_s[cameras++]);
        std::size_t end = i + 1, last_key = i;
        std::optional<std::size_t> old;
        for (; end < lines.size() && !trimmed(lines[end]).starts_with('['); ++end) {
            const std::string_view line = trimmed(lines[end]);
            if (line.empty() || line.starts_with('#')) continue;
            last_key = end;
            if (sets_key(line, "offset_s")) old = end;
        }
        if (old) {
            std::string& line = lines[*old];
            const std::size_t value = line.find_first_not_of(" \t", line.find('=') + 1);
            const std::size_t behind = std::min(line.find_first_of(" \t#\r\n", value), line.size());
            if (value == std::string::npos) return unknown();
            line.replace(value, behind - value, offset);
        } else {
            std::string& line = lines[last_key];
            const std::string ending = line.ends_with("\r\n") ? "\r\n" : "\n";
            if (!line.ends_with('\n')) line += ending;
            const std::string_view key_line(line);
            const std::string indent(
                key_line.substr(0, std::min(key_line.find_first_not_of(" \t"), key_line.size())));
            line += indent + "offset_s = " + offset + ending;
        }
        for (; i < end; ++i) out += lines[i];
    }
    if (cameras != offsets_s.size()) return unknown();
    return out;
}

absl::Status write_offsets(const std::filesystem::path& session_file, std::span<const double> offsets_s) {
    auto session = read_session(session_file);
    if (!session.ok()) return session.status();
    if (session->cameras.size() != offsets_s.size())
        return absl::InvalidArgumentError(fmt::format("{}: has {} cameras, {} offsets were given",
                                                      session_file.string(), session->cameras.size(),
                                                      offsets_s.size()));
    const auto text = read_file(session_file);
    const auto folder = folder_of(session_file);
    if (!text.ok()) return text.status();
    if (!folder.ok()) return folder.status();
    const auto changed = with_offsets(*text, offsets_s);
    // What was changed as text must read as what was meant.
    const auto meant = [&](const absl::StatusOr<Session>& read) {
        if (!read.ok() || !same_but_offsets(*read, *session)) return false;
        for (std::size_t c = 0; c < offsets_s.size(); ++c) {
            const auto& offset = read->cameras[c].offset_s;
            if (!offset || !(std::abs(*offset - offsets_s[c]) < 1e-6)) return false;
        }
        return true;
    };
    if (changed.ok() && meant(parse_session_toml(*changed, *folder, session_file.string(), true)))
        return write_file_atomically(session_file, *changed);
    for (std::size_t c = 0; c < offsets_s.size(); ++c) session->cameras[c].offset_s = offsets_s[c];
    return write_session(*session, session_file);
}

}  // namespace kinevox
