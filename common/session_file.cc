#include "common/session_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <system_error>

#include "common/calibration_file.h"
#include "common/files.h"
#include "common/toml_reader.h"

namespace kinevox {
namespace {

constexpr double kMinFps = 0.01, kMaxFps = 100000;
constexpr double kMaxOffset_s = 86400;

// Before version 1.
constexpr RenamedKey kRenamedKeys[] = {{"recording.times", "recording.frame_times"},
                                       {"recording.started_utc_ns", "recording.start_time_utc_ns"},
                                       {"recording.frames", "recording.frame_sets"},
                                       {"recording.dropped", "recording.dropped_frame_sets"},
                                       {"recording.lost", "recording.lost_frame_sets"},
                                       {"recording.missing_pictures", "recording.missing_images"}};

// The path that a key holds, made absolute; notes an error if it does not exist.
std::filesystem::path read_path(const TomlTable& table, const char* key, bool required,
                                const std::filesystem::path& folder, bool check_exists) {
    const std::string text = required ? table.text(key) : table.text_or(key, "");
    if (text.empty() || text.find('\0') != std::string::npos) {
        if (table.has(key)) table.fail(key, "is empty; give a path relative to the session file");
        return {};
    }
    const std::filesystem::path path = (folder / text).lexically_normal();
    std::error_code ignored;
    if (check_exists && !std::filesystem::exists(path, ignored))
        table.fail(key,
                   fmt::format("is \"{}\", but {} does not exist; correct the path or put the file there",
                               text, path.string()),
                   absl::StatusCode::kNotFound);
    return path;
}

// Relative to the folder if it is below it.
std::string written_path(const std::filesystem::path& path, const std::filesystem::path& folder) {
    if (path.is_relative()) return path.lexically_normal().generic_string();
    const std::filesystem::path relative = path.lexically_normal().lexically_relative(folder);
    const bool below = !relative.empty() && *relative.begin() != "..";
    return (below ? relative : path).generic_string();
}

SessionRecording read_recording(const TomlTable& table, const std::filesystem::path& folder,
                                bool check_files_exist) {
    constexpr std::int64_t kMaxCount = std::numeric_limits<std::int64_t>::max();
    SessionRecording recording;
    recording.frame_times = read_path(table, "frame_times", true, folder, check_files_exist);
    recording.poses = read_path(table, "poses", false, folder, check_files_exist);
    recording.volumes = read_path(table, "volumes", false, folder, check_files_exist);
    recording.codec = table.text_or("codec", "");
    recording.calibration_id = table.text_or("calibration_id", "");
    recording.closed = table.boolean_or("closed", false);
    recording.recovered = table.boolean_or("recovered", false);
    recording.end_reason = table.text_or("end_reason", "");
    recording.start_time_utc_ns = table.integer_or("start_time_utc_ns", 0, 0, kMaxCount);
    const auto count = [&](const char* key) {
        return static_cast<std::uint64_t>(table.integer_or(key, 0, 0, kMaxCount));
    };
    recording.frame_sets = count("frame_sets");
    recording.dropped_frame_sets = count("dropped_frame_sets");
    recording.lost_frame_sets = count("lost_frame_sets");
    recording.missing_images = count("missing_images");
    return recording;
}

std::string recording_toml(const SessionRecording& recording, const std::filesystem::path& folder) {
    std::string out = fmt::format("\n[recording]\nframe_times = {}\n",
                                  toml_quoted(written_path(recording.frame_times, folder)));
    if (!recording.poses.empty())
        out += fmt::format("poses = {}\n", toml_quoted(written_path(recording.poses, folder)));
    if (!recording.volumes.empty())
        out += fmt::format("volumes = {}\n", toml_quoted(written_path(recording.volumes, folder)));
    out += fmt::format("codec = {}\ncalibration_id = {}\nclosed = {}\nrecovered = {}\nend_reason = {}\n",
                       toml_quoted(recording.codec), toml_quoted(recording.calibration_id), recording.closed,
                       recording.recovered, toml_quoted(recording.end_reason));
    return out + fmt::format(
                     "start_time_utc_ns = {}\nframe_sets = {}\ndropped_frame_sets = {}\nlost_frame_sets = "
                     "{}\nmissing_images = {}\n",
                     recording.start_time_utc_ns, recording.frame_sets, recording.dropped_frame_sets,
                     recording.lost_frame_sets, recording.missing_images);
}

}  // namespace

absl::StatusOr<Session> parse_session_toml(const std::string& text, const std::filesystem::path& folder,
                                           const std::string& name_for_errors, bool check_files_exist) {
    absl::StatusOr<std::unique_ptr<TomlDocument>> document =
        TomlDocument::parse(text, name_for_errors, kRenamedKeys);
    if (!document.ok()) return document.status();
    const TomlTable root = (*document)->root();
    Session session;
    session.name = root.text_or("name", folder.filename().string());
    session.fps = root.number("fps", {kMinFps, kMaxFps});
    session.calibration = read_path(root, "calibration", true, folder, check_files_exist);
    session.truth = read_path(root, "truth", false, folder, check_files_exist);
    std::error_code ignored;
    if (session.truth.empty() && check_files_exist &&
        std::filesystem::is_directory(folder / "truth", ignored))
        session.truth = folder / "truth";
    for (const TomlTable& table : root.tables("camera")) {
        SessionCamera camera;
        camera.name = table.text("name");
        camera.video = read_path(table, "video", true, folder, check_files_exist);
        camera.background = read_path(table, "background", false, folder, check_files_exist);
        if (table.has("offset_s")) {
            camera.offset_s = table.number("offset_s", {-kMaxOffset_s, kMaxOffset_s});
            if (root.has("recording"))
                table.fail("offset_s",
                           "is not allowed in a session with [recording], whose cameras are synchronised; "
                           "remove it");
        }
        if (const std::string problem = camera_name_problem(camera.name);
            !problem.empty() && table.has("name"))
            table.fail("name", problem);
        const auto same_name = [&](const SessionCamera& other) { return other.name == camera.name; };
        if (std::any_of(session.cameras.begin(), session.cameras.end(), same_name))
            table.fail("name",
                       fmt::format("is \"{}\", the name of an earlier [[camera]]; names must be unique",
                                   camera.name));
        session.cameras.push_back(std::move(camera));
    }
    if (root.has("recording"))
        session.recording = read_recording(root.table_or_empty("recording"), folder, check_files_exist);
    if (absl::Status status = (*document)->finish(); !status.ok()) return status;
    if (session.cameras.empty())
        return absl::InvalidArgumentError(fmt::format(
            "{}: no camera; add a table [[camera]] with name and video for each", name_for_errors));
    return session;
}

absl::StatusOr<Session> read_session(const std::filesystem::path& file) {
    const absl::StatusOr<std::string> text = read_file(file);
    if (!text.ok()) return text.status();
    const absl::StatusOr<std::filesystem::path> folder = folder_of(file);
    if (!folder.ok()) return folder.status();
    return parse_session_toml(*text, *folder, file.string(), true);
}

absl::StatusOr<std::vector<Camera>> read_session_cameras(const Session& session) {
    absl::StatusOr<std::vector<Camera>> calibrated = read_calibration(session.calibration);
    if (!calibrated.ok()) return calibrated.status();
    std::vector<Camera> cameras;
    for (const SessionCamera& wanted : session.cameras) {
        const Camera* const found = camera_named(*calibrated, wanted.name);
        if (!found) {
            std::vector<std::string> names;
            for (const Camera& camera : *calibrated) names.push_back(camera.name);
            return absl::NotFoundError(fmt::format(
                "session \"{}\": camera \"{}\" is not in the calibration {}, which has {}; correct the name",
                session.name, wanted.name, session.calibration.string(), fmt::join(names, ", ")));
        }
        cameras.push_back(*found);
    }
    return cameras;
}

absl::Status write_session(const Session& session, const std::filesystem::path& file) {
    std::error_code error;
    const std::filesystem::path folder =
        std::filesystem::absolute(file, error).lexically_normal().parent_path();
    if (error)
        return absl::InvalidArgumentError(
            fmt::format("{}: {}; check the path", file.string(), error.message()));
    const auto path_text = [&](const std::filesystem::path& path) {
        return toml_quoted(written_path(path, folder));
    };
    std::string out = fmt::format(
        "# A capture session on disk. Paths are relative to this file.\nname = {}\nfps = {}\ncalibration = "
        "{}\n",
        toml_quoted(session.name), toml_number(session.fps), path_text(session.calibration));
    if (!session.truth.empty() && session.truth.lexically_normal() != folder / "truth")
        out += fmt::format("truth = {}\n", path_text(session.truth));
    for (const SessionCamera& camera : session.cameras) {
        out += fmt::format("\n[[camera]]\nname = {}\nvideo = {}\n", toml_quoted(camera.name),
                           path_text(camera.video));
        if (!camera.background.empty()) out += fmt::format("background = {}\n", path_text(camera.background));
        if (camera.offset_s) out += fmt::format("offset_s = {}\n", toml_number(*camera.offset_s));
    }
    if (session.recording) out += recording_toml(*session.recording, folder);
    if (const auto read_back = parse_session_toml(out, folder, file.string(), false); !read_back.ok())
        return absl::InvalidArgumentError(fmt::format("session not written, it would be invalid: {}",
                                                      std::string(read_back.status().message())));
    return write_file_atomically(file, out);
}

}  // namespace kinevox
