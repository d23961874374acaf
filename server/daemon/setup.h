// From the configuration to the daemon's parts.
#pragma once

#include <memory>
#include <string>

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include "common/config.h"
#include "server/api/api_context.h"
#include "server/cameras/frame_source.h"
#include "server/pipeline/pipeline.h"

namespace kinevox {

// spdlog's default logger: standard error, and the file where one is configured. gRPC's own messages go to it, too,
// at debug. Unavailable where the file cannot be written.
absl::Status set_up_logging(const LogConfig& config);

absl::StatusOr<std::unique_ptr<FrameSource>> open_source(const SourceConfig& config);
std::string describe(const SourceConfig& config);   // "studio walk", "session /data/trial/session.toml"

absl::StatusOr<PipelineOptions> pipeline_options(const DaemonConfig& config);
ControlLeaseOptions lease_options(const ControlConfig& config);
void apply(const StreamConfig& config, ApiContext& api);

}  // namespace kinevox
