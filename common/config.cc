#include "common/config.h"

#include <fmt/format.h>

#include <charconv>
#include <system_error>

#include "common/atomic_file.h"
#include "common/toml_reader.h"

namespace kinevox {
namespace {

std::filesystem::path resolved(const std::string& text, const std::filesystem::path& folder) {
    return text.empty() ? std::filesystem::path() : (folder / text).lexically_normal();
}

void read_server(const TomlTable& table, const std::filesystem::path& folder, bool check_files_exist,
                 ServerConfig& server) {
    server.listen = table.text_or("listen", server.listen);
    if (const std::string problem = listen_address_problem(server.listen); !problem.empty())
        table.fail("listen", problem);
    read_access(table, folder, check_files_exist, server.access);
}

void read_studio(const TomlTable& table, StudioConfig& studio) {
    studio.motion = table.choice_or("motion", studio.motion, {kStudioMotions.begin(), kStudioMotions.end()});
    studio.cameras = static_cast<int>(table.integer_or("cameras", studio.cameras, 2, 64));
    studio.width = static_cast<int>(table.integer_or("width", studio.width, 64, 4096));
    studio.height = static_cast<int>(table.integer_or("height", studio.height, 64, 4096));
    studio.fps = table.number_or("fps", studio.fps, {1, 1000});
    studio.seed = static_cast<std::uint32_t>(table.integer_or("seed", studio.seed, 0, 0xffffffff));
    studio.subject_height_m = table.number_or("subject_height_m", studio.subject_height_m, {0, 2.2});
    if (studio.subject_height_m > 0 && studio.subject_height_m < 1.2)
        table.fail("subject_height_m",
                   fmt::format("is {}, expected 1.2 to 2.2, or 0 to draw one from the seed; "
                               "correct it",
                               studio.subject_height_m));
}

void read_source(const TomlTable& table, const std::filesystem::path& folder, bool check_files_exist,
                 SourceConfig& source) {
    const std::string kind = table.choice_or("kind", "studio", {"studio", "session", "cameras"});
    source.kind = kind == "session"   ? SourceConfig::Kind::kSession
                  : kind == "cameras" ? SourceConfig::Kind::kCameras
                                      : SourceConfig::Kind::kStudio;
    const std::string session = table.text_or("session", "");
    source.session = resolved(session, folder);
    std::error_code ignored;
    if (source.kind == SourceConfig::Kind::kSession) {
        if (session.empty())
            table.fail("session", "is missing, but kind is \"session\"; give the path of a session.toml");
        else if (check_files_exist && !std::filesystem::exists(source.session, ignored))
            table.fail("session",
                       fmt::format("is \"{}\", but {} does not exist; correct the path", session,
                                   source.session.string()),
                       absl::StatusCode::kNotFound);
    }
    const std::string pacing = table.choice_or("pacing", "real_time", {"real_time", "as_fast_as_possible"});
    source.pacing =
        pacing == "real_time" ? SourceConfig::Pacing::kRealTime : SourceConfig::Pacing::kAsFastAsPossible;
    source.loop = table.boolean_or("loop", source.loop);
    source.autostart = table.boolean_or("autostart", source.autostart);
    read_studio(table.table_or_empty("studio"), source.studio);
    read_live_cameras(table.table_or_empty("cameras"), folder, check_files_exist,
                      source.kind == SourceConfig::Kind::kCameras, source.cameras);
}

void read_pipeline(const TomlTable& table, PipelineConfig& pipeline) {
    const std::string device = table.choice_or("device", "cpu", {"cpu", "cuda"});
    pipeline.device = device == "cuda" ? PipelineConfig::Device::kCuda : PipelineConfig::Device::kCpu;
    pipeline.voxel_mm = table.number_or("voxel_mm", pipeline.voxel_mm, {2, 100});
    pipeline.colouring = table.boolean_or("colouring", pipeline.colouring);
    pipeline.threads = static_cast<int>(table.integer_or("threads", pipeline.threads, 0, 1024));
}

void read_segmentation(const TomlTable& table, const std::filesystem::path& folder,
                       SegmentationConfig& segmentation) {
    segmentation.samples = static_cast<int>(table.integer_or("samples", segmentation.samples, 4, 255));
    const std::string stored = table.text_or("stored_background", "");
    if (table.has("stored_background")) segmentation.stored_background = resolved(stored, folder);
    segmentation.sharp_threshold = table.number_or("sharp_threshold", segmentation.sharp_threshold, {0, 1});
    segmentation.loose_threshold = table.number_or("loose_threshold", segmentation.loose_threshold, {0, 1});
    if (segmentation.loose_threshold > segmentation.sharp_threshold)
        table.fail("loose_threshold",
                   fmt::format("is {}, above sharp_threshold, which is {}; lower it",
                               segmentation.loose_threshold, segmentation.sharp_threshold));
}

void read_pose(const TomlTable& table, const std::filesystem::path& folder, bool check_files_exist,
               PoseConfig& pose) {
    pose.enabled = table.boolean_or("enabled", pose.enabled);
    pose.filtered = table.boolean_or("filtered", pose.filtered);
    pose.body = resolved(table.text_or("body", ""), folder);
    std::error_code ignored;
    if (check_files_exist && !pose.body.empty() && !std::filesystem::exists(pose.body, ignored))
        table.fail("body",
                   fmt::format("is {}, which does not exist; kinevox process --tpose writes one",
                               pose.body.string()),
                   absl::StatusCode::kNotFound);
    pose.fit_body = table.boolean_or("fit_body", pose.fit_body);
    const std::string fitted_body = table.text_or("fitted_body", "");
    if (table.has("fitted_body")) pose.fitted_body = resolved(fitted_body, folder);
    const std::string database = table.text_or("database", "");
    if (table.has("database")) pose.database = resolved(database, folder);
    pose.database_poses = static_cast<int>(table.integer_or("database_poses", pose.database_poses, 1, 4000));
}

void read_calibration_config(const TomlTable& table, const std::filesystem::path& base,
                             CalibrationConfig& calibration) {
    const std::string folder = table.text_or("folder", "");
    if (table.has("folder")) calibration.folder = resolved(folder, base);
}

void read_recording_config(const TomlTable& table, const std::filesystem::path& base,
                           RecordingConfig& recording) {
    const std::string folder = table.text_or("folder", "");
    if (table.has("folder")) recording.folder = resolved(folder, base);
    recording.codec = table.choice_or("codec", recording.codec, {"ffv1", "utvideo", "h264"});
    recording.poses = table.boolean_or("poses", recording.poses);
    recording.volumes = table.boolean_or("volumes", recording.volumes);
    recording.keep_last_s = table.number_or("keep_last_s", recording.keep_last_s, {0, 3600});
    const auto megabytes = [&](const char* key, int& value, int lowest) {
        value = static_cast<int>(table.integer_or(key, value, lowest, 1 << 20));
    };
    megabytes("keep_last_mb", recording.keep_last_mb, 1);
    megabytes("queue_mb", recording.queue_mb, 1);
    megabytes("least_free_mb", recording.min_free_mb, 0);
    recording.keep_days = table.number_or("keep_days", recording.keep_days, {0, 36500});
    recording.keep_gb = table.number_or("keep_gb", recording.keep_gb, {0, 1e6});
}

void read_stream(const TomlTable& table, StreamConfig& stream) {
    stream.lossless_max_messages =
        static_cast<int>(table.integer_or("lossless_max_messages", stream.lossless_max_messages, 1, 100000));
    stream.lossless_max_mb =
        static_cast<int>(table.integer_or("lossless_max_mb", stream.lossless_max_mb, 1, 4096));
    stream.newest_per_s = table.number_or("newest_per_s", stream.newest_per_s, {0, 1e9});
    stream.preview_width_px =
        static_cast<int>(table.integer_or("preview_width_px", stream.preview_width_px, 16, 8192));
    stream.preview_jpeg_quality =
        static_cast<int>(table.integer_or("preview_jpeg_quality", stream.preview_jpeg_quality, 1, 100));
}

void read_control(const TomlTable& table, ControlConfig& control) {
    control.lease_timeout_s = table.number_or("lease_timeout_s", control.lease_timeout_s, {1, 86400});
    control.max_lease_timeout_s =
        table.number_or("longest_lease_timeout_s", control.max_lease_timeout_s, {1, 86400});
    if (control.lease_timeout_s > control.max_lease_timeout_s)
        table.fail("lease_timeout_s",
                   fmt::format("is {}, above longest_lease_timeout_s, which is {}; lower it",
                               control.lease_timeout_s, control.max_lease_timeout_s));
}

void read_metrics(const TomlTable& table, MetricsConfig& metrics) {
    metrics.listen = table.text_or("listen", metrics.listen);
    if (metrics.listen.empty()) return;
    if (const std::string problem = listen_address_problem(metrics.listen); !problem.empty())
        table.fail("listen", problem);
}

void read_log(const TomlTable& table, const std::filesystem::path& folder, LogConfig& log) {
    log.level = table.choice_or("level", log.level, {"trace", "debug", "info", "warning", "error", "off"});
    log.file = resolved(table.text_or("file", ""), folder);
}

}  // namespace

std::string listen_address_problem(std::string_view text) {
    const std::string given =
        fmt::format("is \"{}\", expected HOST:PORT such as 127.0.0.1:50770; ", text.substr(0, 80));
    const std::size_t colon = text.rfind(':');
    if (colon == std::string_view::npos || colon == 0) return given + "give host and port";
    const std::string_view host = text.substr(0, colon), port_text = text.substr(colon + 1);
    for (const char c : host)
        if (static_cast<unsigned char>(c) <= ' ' || c == 0x7f || c == '/') return given + "correct the host";
    if (host.find(':') != std::string_view::npos && !(host.starts_with('[') && host.ends_with(']')))
        return given + "put an IPv6 host into brackets";
    unsigned port = 0;
    const auto [end, code] = std::from_chars(port_text.data(), port_text.data() + port_text.size(), port);
    if (code != std::errc{} || end != port_text.data() + port_text.size() || port > 65535)
        return given + "the port is a number from 0 to 65535";
    return "";
}

absl::StatusOr<DaemonConfig> parse_config_toml(const std::string& text, const std::filesystem::path& folder,
                                               const std::string& name_for_errors, bool check_files_exist) {
    const absl::StatusOr<std::unique_ptr<TomlDocument>> document = TomlDocument::parse(text, name_for_errors);
    if (!document.ok()) return document.status();
    const TomlTable root = (*document)->root();
    DaemonConfig config;
    read_server(root.table_or_empty("server"), folder, check_files_exist, config.server);
    read_source(root.table_or_empty("source"), folder, check_files_exist, config.source);
    read_pipeline(root.table_or_empty("pipeline"), config.pipeline);
    read_segmentation(root.table_or_empty("segmentation"), folder, config.segmentation);
    read_pose(root.table_or_empty("pose"), folder, check_files_exist, config.pose);
    read_calibration_config(root.table_or_empty("calibration"), folder, config.calibration);
    read_recording_config(root.table_or_empty("recording"), folder, config.recording);
    read_stream(root.table_or_empty("stream"), config.stream);
    read_control(root.table_or_empty("control"), config.control);
    read_metrics(root.table_or_empty("metrics"), config.metrics);
    read_log(root.table_or_empty("log"), folder, config.log);
    if (absl::Status status = (*document)->finish(); !status.ok()) return status;
    return config;
}

absl::StatusOr<DaemonConfig> read_config(const std::filesystem::path& file) {
    const absl::StatusOr<std::string> text = read_file(file);
    if (!text.ok()) return text.status();
    const absl::StatusOr<std::filesystem::path> folder = folder_of(file);
    if (!folder.ok()) return folder.status();
    return parse_config_toml(*text, *folder, file.string(), true);
}

}  // namespace kinevox
