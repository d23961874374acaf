#include "server/daemon/setup.h"

#include <fmt/format.h>
#include <grpc/support/log.h>
#include <spdlog/sinks/basic_file_sink.h>
#include <spdlog/sinks/stdout_color_sinks.h>
#include <spdlog/spdlog.h>

#include "server/cameras/session_source.h"
#include "server/cameras/studio/studio_source.h"

namespace kinevox {
namespace {

std::chrono::milliseconds milliseconds(double seconds) {
    return std::chrono::milliseconds(static_cast<std::int64_t>(seconds * 1000));
}

}  // namespace

absl::Status set_up_logging(const LogConfig& config) {
    std::vector<spdlog::sink_ptr> sinks{std::make_shared<spdlog::sinks::stderr_color_sink_mt>()};
    if (!config.file.empty()) {
        try {
            sinks.push_back(std::make_shared<spdlog::sinks::basic_file_sink_mt>(config.file.string()));
        } catch (const spdlog::spdlog_ex& error) {
            return absl::UnavailableError(fmt::format("{}: the log cannot be written ({}); correct [log] file",
                                                      config.file.string(), error.what()));
        }
    }
    auto logger = std::make_shared<spdlog::logger>("kinevoxd", sinks.begin(), sinks.end());
    logger->set_level(spdlog::level::from_str(config.level));
    logger->set_pattern("%Y-%m-%dT%H:%M:%S.%e %^%L%$ %v");
    logger->flush_on(spdlog::level::info);
    spdlog::set_default_logger(std::move(logger));
    gpr_set_log_function([](gpr_log_func_args* args) { spdlog::debug("gRPC: {}", args->message); });
    return absl::OkStatus();
}

absl::StatusOr<std::unique_ptr<FrameSource>> open_source(const SourceConfig& config) {
    const Pacing pacing =
        config.pacing == SourceConfig::Pacing::kRealTime ? Pacing::kRealTime : Pacing::kAsFastAsPossible;
    switch (config.kind) {
        case SourceConfig::Kind::kSession:
            return open_session_source(config.session, {.pacing = pacing, .loop = config.loop});
        case SourceConfig::Kind::kStudio: {
            StudioSourceOptions options;
            options.studio.motion = config.studio.motion;
            options.studio.cameras = config.studio.cameras;
            options.studio.width = config.studio.width;
            options.studio.height = config.studio.height;
            options.studio.fps = config.studio.fps;
            options.studio.seed = config.studio.seed;
            options.studio.subject_height_m = config.studio.subject_height_m;
            options.pacing = pacing;
            return StudioSource::create(options);
        }
    }
    return absl::InternalError("a source of a kind that nobody wrote");
}

std::string describe(const SourceConfig& config) {
    return config.kind == SourceConfig::Kind::kSession ? "session " + config.session.string()
                                                       : "studio " + config.studio.motion;
}

absl::StatusOr<PipelineOptions> pipeline_options(const DaemonConfig& config) {
    PipelineOptions options;
    options.device =
        config.pipeline.device == PipelineConfig::Device::kCuda ? kernels::Device::kCuda : kernels::Device::kCpu;
    options.voxel_m = config.pipeline.voxel_mm / 1000;
    options.colouring = config.pipeline.colouring;
    options.pose = config.pose.enabled;
    options.posing.filtered = config.pose.filtered;
    if (!config.pose.body.empty()) {
        absl::StatusOr<BodyShape> body = read_body_shape(config.pose.body);
        if (!body.ok()) return body.status();
        options.posing.body = *std::move(body);
    }
    options.segmentation.samples = config.segmentation.samples;
    options.segmentation.sharp_threshold = static_cast<float>(config.segmentation.sharp_threshold);
    options.segmentation.loose_threshold = static_cast<float>(config.segmentation.loose_threshold);
    return options;
}

ControlLeaseOptions lease_options(const ControlConfig& config) {
    return {milliseconds(config.lease_timeout_s), milliseconds(config.longest_lease_timeout_s)};
}

void apply(const StreamConfig& config, ApiContext& api) {
    api.lossless_max_messages = static_cast<std::size_t>(config.lossless_max_messages);
    api.lossless_max_bytes = static_cast<std::size_t>(config.lossless_max_mb) << 20;
    api.preview_width_px = config.preview_width_px;
    api.preview_jpeg_quality = config.preview_jpeg_quality;
}

}  // namespace kinevox
