#include "server/config/daemon_config.h"

#include <fmt/format.h>

#include <system_error>

#include "common/files.h"
#include "common/host_port.h"
#include "common/toml_reader.h"
#include "server/config/config_reader.h"
#include "server/pipeline/pipeline.h"

namespace kinevox {
namespace {

std::filesystem::path resolved(const std::string& text, const std::filesystem::path& folder) {
    return text.empty() ? std::filesystem::path() : (folder / text).lexically_normal();
}

// Stays empty where the key is missing, which is not the same as an empty path.
void read_optional_path(const TomlTable& table, const char* key, const std::filesystem::path& folder,
                        std::optional<std::filesystem::path>& path) {
    const std::string text = table.text_or(key, "");
    if (table.has(key)) path = resolved(text, folder);
}

void read_server(const TomlTable& table, const std::filesystem::path& folder, bool check_files_exist,
                 ServerConfig& server) {
    server.listen = table.text_or("listen", server.listen);
    if (const std::string problem = listen_address_problem(server.listen); !problem.empty())
        table.fail("listen", problem);
    read_access(table, folder, check_files_exist, server.access);
    read_options(table.table_or_empty("limits"), server.access);
}

void read_studio(const TomlTable& table, StudioConfig& studio) {
    studio.motion = table.choice_or("motion", studio.motion, {kStudioMotions.begin(), kStudioMotions.end()});
    read_options(table, studio);
    if (studio.stature_m > 0 && studio.stature_m < 1.2)
        table.fail("stature_m",
                   fmt::format("is {}, expected 1.2 to 2.2, or 0 to draw it from the seed; correct it",
                               studio.stature_m));
}

void read_source(const TomlTable& table, const std::filesystem::path& folder, bool check_files_exist,
                 SourceConfig& source) {
    const std::string kind = table.choice_or("kind", "studio", {"studio", "session", "cameras"});
    source.kind = kind == "session"   ? SourceConfig::Kind::kSession
                  : kind == "cameras" ? SourceConfig::Kind::kCameras
                                      : SourceConfig::Kind::kStudio;
    const std::string session = table.text_or("session_file", "");
    source.session_file = resolved(session, folder);
    std::error_code ignored;
    if (source.kind == SourceConfig::Kind::kSession) {
        if (session.empty())
            table.fail("session_file",
                       "is missing, but kind is \"session\"; give the path of a session.toml");
        else if (check_files_exist && !std::filesystem::exists(source.session_file, ignored))
            table.fail("session_file",
                       fmt::format("is \"{}\", but {} does not exist; correct the path", session,
                                   source.session_file.string()),
                       absl::StatusCode::kNotFound);
    }
    const std::string pacing = table.choice_or("pacing", "real_time", {"real_time", "as_fast_as_possible"});
    source.pacing =
        pacing == "real_time" ? SourceConfig::Pacing::kRealTime : SourceConfig::Pacing::kAsFastAsPossible;
    read_options(table, source);
    read_studio(table.table_or_empty("studio"), source.studio);
    read_live_cameras(table.table_or_empty("cameras"), folder, check_files_exist,
                      source.kind == SourceConfig::Kind::kCameras, source.cameras);
}

void read_pipeline(const TomlTable& table, PipelineConfig& pipeline) {
    const std::string device = table.choice_or("device", "cpu", {"cpu", "cuda"});
    pipeline.device = device == "cuda" ? PipelineConfig::Device::kCuda : PipelineConfig::Device::kCpu;
    read_options(table, pipeline);
}

void read_segmentation(const TomlTable& table, const std::filesystem::path& folder,
                       SegmentationConfig& segmentation) {
    read_options(table, segmentation.options);
    read_options(table, segmentation);
    read_optional_path(table, "background_folder", folder, segmentation.background_folder);
    if (segmentation.options.loose_threshold > segmentation.options.sharp_threshold)
        table.fail("loose_threshold",
                   fmt::format("is {}, above sharp_threshold, which is {}; lower it",
                               segmentation.options.loose_threshold, segmentation.options.sharp_threshold));
}

std::vector<FloorRegion> read_regions(const TomlTable& table, const char* key) {
    constexpr std::size_t kMaxCorners = 64;
    std::vector<FloorRegion> regions;
    for (const TomlTable& each : table.tables(key)) {
        FloorRegion region;
        const std::vector<double> corners = each.rows("corners_m", 3, kMaxCorners, 2);
        for (std::size_t k = 0; k + 1 < corners.size(); k += 2)
            region.corners.push_back({corners[k], corners[k + 1]});
        if (const std::string problem = region.check(); !problem.empty()) each.fail("corners_m", problem);
        regions.push_back(std::move(region));
    }
    return regions;
}

void read_tracking(const TomlTable& table, TrackerOptions& tracking) {
    read_options(table, tracking);
    SubjectRules& rules = tracking.rules;
    if (table.choice_or("follow", "first", {"first", "nearest"}) == "nearest")
        rules.follow = SubjectRules::Follow::kNearest;
    if (table.has("follow_point_m")) {
        const std::vector<double> point = table.numbers("follow_point_m", 2, 2, {-1000, 1000});
        rules.point = {point[0], point[1]};
    }
    rules.capture_regions = read_regions(table, "capture_region");
    rules.keep_out_regions = read_regions(table, "keep_out_region");
}

void read_pose(const TomlTable& table, const std::filesystem::path& folder, bool check_files_exist,
               PoseConfig& pose) {
    read_options(table, pose);
    read_options(table, pose.options);
    read_options(table.table_or_empty("tracking"), pose.options.tracker);
    const TomlTable fit = table.table_or_empty("fit");
    read_options(fit, pose.options.tracker.fit);
    if (const auto& options = pose.options.tracker.fit; options.wide_m < options.narrow_m)
        fit.fail("wide_m", fmt::format("is {}, below narrow_m, which is {}; raise it", options.wide_m,
                                       options.narrow_m));
    read_options(table.table_or_empty("filter"), pose.options.filter);
    pose.body_file = resolved(table.text_or("body_file", ""), folder);
    std::error_code ignored;
    if (check_files_exist && !pose.body_file.empty() && !std::filesystem::exists(pose.body_file, ignored))
        table.fail("body_file",
                   fmt::format("is {}, which does not exist; kinevox process --tpose writes one",
                               pose.body_file.string()),
                   absl::StatusCode::kNotFound);
    read_optional_path(table, "fitted_body_file", folder, pose.fitted_body_file);
    read_optional_path(table, "database_file", folder, pose.database_file);
}

void read_recording(const TomlTable& table, const std::filesystem::path& base, RecordingConfig& recording) {
    read_optional_path(table, "folder", base, recording.folder);
    recording.codec = table.choice_or("codec", recording.codec, {"ffv1", "utvideo", "h264"});
    read_options(table, recording);
}

void read_replay(const TomlTable& table, const std::filesystem::path& base, ReplayConfig& replay) {
    for (const std::string& text : table.texts_or_empty("folders")) {
        if (text.empty()) table.fail("folders", "holds an empty path; remove it");
        replay.folders.push_back(resolved(text, base));
    }
}

void read_control(const TomlTable& table, ControlConfig& control) {
    read_options(table, control);
    if (control.default_lease_s > control.max_lease_s)
        table.fail("default_lease_s", fmt::format("is {}, above max_lease_s, which is {}; lower it",
                                                  control.default_lease_s, control.max_lease_s));
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
    if (parse_host_port(text)) return "";
    return fmt::format(
        "is \"{}\", expected HOST:PORT such as 127.0.0.1:50770 or [::1]:50770, port 0 to 65535; correct it",
        text.substr(0, 80));
}

absl::StatusOr<DaemonConfig> parse_config_toml(const std::string& text, const std::filesystem::path& folder,
                                               const std::string& name_for_errors, bool check_files_exist) {
    const absl::StatusOr<std::unique_ptr<TomlDocument>> document =
        TomlDocument::parse(text, name_for_errors, renamed_config_keys());
    if (!document.ok()) return document.status();
    const TomlTable root = (*document)->root();
    DaemonConfig config;
    read_server(root.table_or_empty("server"), folder, check_files_exist, config.server);
    read_source(root.table_or_empty("source"), folder, check_files_exist, config.source);
    read_pipeline(root.table_or_empty("pipeline"), config.pipeline);
    read_segmentation(root.table_or_empty("segmentation"), folder, config.segmentation);
    read_tracking(root.table_or_empty("tracking"), config.tracking);
    read_options(root.table_or_empty("hull"), config.hull);
    read_options(root.table_or_empty("colouring"), config.colouring);
    read_pose(root.table_or_empty("pose"), folder, check_files_exist, config.pose);
    read_optional_path(root.table_or_empty("calibration"), "folder", folder, config.calibration.folder);
    read_recording(root.table_or_empty("recording"), folder, config.recording);
    read_replay(root.table_or_empty("replay"), folder, config.replay);
    read_options(root.table_or_empty("stream"), config.stream);
    read_control(root.table_or_empty("control"), config.control);
    read_metrics(root.table_or_empty("metrics"), config.metrics);
    read_log(root.table_or_empty("log"), folder, config.log);
    if (absl::Status status = (*document)->finish(); !status.ok()) return status;
    return config;
}

absl::StatusOr<DaemonConfig> read_config(const std::filesystem::path& file, bool check_files_exist) {
    const absl::StatusOr<std::string> text = read_file(file);
    if (!text.ok()) return text.status();
    const absl::StatusOr<std::filesystem::path> folder = folder_of(file);
    if (!folder.ok()) return folder.status();
    return parse_config_toml(*text, *folder, file.string(), check_files_exist);
}

absl::StatusOr<PipelineOptions> pipeline_options(const DaemonConfig& config) {
    PipelineOptions options;
    options.device = config.pipeline.device == PipelineConfig::Device::kCuda ? kernels::Device::kCuda
                                                                             : kernels::Device::kCpu;
    options.voxel_m = config.pipeline.voxel_mm / 1000;
    options.colouring = config.pipeline.colouring;
    options.pose = config.pose.enabled;
    options.segmentation = config.segmentation.options;
    options.tracker = config.tracking;
    options.hull = config.hull;
    options.colour = config.colouring;
    options.posing = config.pose.options;
    if (!config.pose.body_file.empty()) {
        absl::StatusOr<BodyShape> body = read_body_shape(config.pose.body_file);
        if (!body.ok()) return body.status();
        options.posing.set_body(*body);
    }
    return options;
}

}  // namespace kinevox
