#include "server/config/daemon_config.h"

#include <fmt/format.h>

#include <system_error>
#include <utility>

#include "common/files.h"
#include "common/host_port.h"
#include "common/toml_reader.h"
#include "server/config/config_reader.h"
#include "server/pipeline/pipeline.h"

namespace kinevox {
kernels::Device device_or(const TomlTable& table, const char* key, kernels::Device fallback) {
    const std::string name = table.text_or(key, kernels::name_of(fallback));
    const auto device = kernels::device_of_name(name);
    if (!device) table.fail(key, fmt::format("is '{}'; use {}", name, kernels::kDeviceNames));
    return device.value_or(fallback);
}

namespace {

void read_server(const TomlTable& table, const std::filesystem::path& folder, bool check_files_exist,
                 ServerConfig& server) {
    read_options(table, folder, server);
    if (const std::string problem = listen_address_problem(server.listen); !problem.empty())
        table.fail("listen", problem);
    const AccessConfig& access = server.access;
    if (check_files_exist)
        for (const auto& [key, file] : {std::pair{"tls_certificate_file", access.tls_certificate_file},
                                        {"tls_key_file", access.tls_key_file},
                                        {"tls_client_ca_file", access.tls_client_ca_file},
                                        {"token_file", access.token_file}})
            require_file(table, key, file, "docs/access.md shows how to make it");
    if (access.tls_certificate_file.empty() != access.tls_key_file.empty())
        table.fail(access.tls_key_file.empty() ? "tls_certificate_file" : "tls_key_file",
                   "is given without the other; give tls_certificate_file and tls_key_file");
    if (!access.tls_client_ca_file.empty() && access.tls_certificate_file.empty())
        table.fail("tls_client_ca_file",
                   "is given without tls_certificate_file and tls_key_file; give those too");
    read_options(table.table_or_empty("limits"), folder, server.access);
}

void read_studio(const TomlTable& table, const std::filesystem::path& folder, StudioConfig& studio) {
    read_options(table, folder, studio);
    if (studio.stature_m > 0 && studio.stature_m < 1.2)
        table.fail("stature_m",
                   fmt::format("is {}, expected 1.2 to 2.2, or 0 to draw it from the seed; correct it",
                               studio.stature_m));
}

void read_source(const TomlTable& table, const std::filesystem::path& folder, bool check_files_exist,
                 SourceConfig& source) {
    read_options(table, folder, source);
    if (source.kind == SourceConfig::Kind::kSession) {
        if (source.session_file.empty())
            table.fail("session_file",
                       "is missing, but kind is \"session\"; give the path of a session.toml");
        if (check_files_exist) require_file(table, "session_file", source.session_file, "correct the path");
    }
    read_studio(table.table_or_empty("studio"), folder, source.studio);
    read_live_cameras(table.table_or_empty("cameras"), folder, check_files_exist,
                      source.kind == SourceConfig::Kind::kCameras, source.cameras);
}

void read_segmentation(const TomlTable& table, const std::filesystem::path& folder,
                       SegmentationConfig& segmentation) {
    read_options(table, folder, segmentation.options);
    read_options(table, folder, segmentation);
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

void read_tracking(const TomlTable& table, const std::filesystem::path& folder, TrackerOptions& tracking) {
    read_options(table, folder, tracking);
    SubjectRules& rules = tracking.rules;
    if (table.has("follow_point_m")) {
        const std::vector<double> point = table.numbers("follow_point_m", 2, 2, {-1000, 1000});
        rules.point = {point[0], point[1]};
    }
    rules.capture_regions = read_regions(table, "capture_region");
    rules.keep_out_regions = read_regions(table, "keep_out_region");
}

void read_pose(const TomlTable& table, const std::filesystem::path& folder, bool check_files_exist,
               PoseConfig& pose) {
    read_options(table, folder, pose);
    read_options(table, folder, pose.options);
    read_options(table.table_or_empty("tracking"), folder, pose.options.tracker);
    const TomlTable fit = table.table_or_empty("fit");
    read_options(fit, folder, pose.options.tracker.fit);
    if (const auto& options = pose.options.tracker.fit; options.wide_m < options.narrow_m)
        fit.fail("wide_m", fmt::format("is {}, below narrow_m, which is {}; raise it", options.wide_m,
                                       options.narrow_m));
    read_options(table.table_or_empty("filter"), folder, pose.options.filter);
    if (check_files_exist)
        require_file(table, "body_file", pose.body_file, "kinevox process --tpose writes one");
}

void read_replay(const TomlTable& table, const std::filesystem::path& base, ReplayConfig& replay) {
    for (const std::string& text : table.texts_or_empty("folders")) {
        if (text.empty()) table.fail("folders", "holds an empty path; remove it");
        replay.folders.push_back((base / text).lexically_normal());
    }
}

void read_control(const TomlTable& table, const std::filesystem::path& folder, ControlConfig& control) {
    read_options(table, folder, control);
    if (control.default_lease_s > control.max_lease_s)
        table.fail("default_lease_s", fmt::format("is {}, above max_lease_s, which is {}; lower it",
                                                  control.default_lease_s, control.max_lease_s));
}

void read_metrics(const TomlTable& table, const std::filesystem::path& folder, MetricsConfig& metrics) {
    read_options(table, folder, metrics);
    if (metrics.listen.empty()) return;
    if (const std::string problem = listen_address_problem(metrics.listen); !problem.empty())
        table.fail("listen", problem);
}

}  // namespace

void require_file(const TomlTable& table, const char* key, const std::filesystem::path& file,
                  std::string_view remedy) {
    std::error_code ignored;
    if (!file.empty() && !std::filesystem::exists(file, ignored))
        table.fail(key, fmt::format("is {}, which does not exist; {}", file.string(), remedy),
                   absl::StatusCode::kNotFound);
}

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
    const auto read = [&](const char* table, auto& options) {
        read_options(root.table_or_empty(table), folder, options);
    };
    read_server(root.table_or_empty("server"), folder, check_files_exist, config.server);
    read_source(root.table_or_empty("source"), folder, check_files_exist, config.source);
    read("pipeline", config.pipeline);
    read_segmentation(root.table_or_empty("segmentation"), folder, config.segmentation);
    read_tracking(root.table_or_empty("tracking"), folder, config.tracking);
    read("hull", config.hull);
    read("colouring", config.colouring);
    read_pose(root.table_or_empty("pose"), folder, check_files_exist, config.pose);
    read("calibration", config.calibration);
    read("recording", config.recording);
    read_replay(root.table_or_empty("replay"), folder, config.replay);
    read("stream", config.stream);
    read_control(root.table_or_empty("control"), folder, config.control);
    read_metrics(root.table_or_empty("metrics"), folder, config.metrics);
    read("log", config.log);
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
    options.device = config.pipeline.device;
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
