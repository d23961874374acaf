// What an administrator's monitoring reads of the daemon. docs/monitoring.md lists the metrics.
#pragma once

#include <string>

#include "server/metrics/metrics_text.h"

namespace kinevox {
struct ApiContext;
}

namespace kinevox::metrics {

// Costs about a millisecond; waits for nothing. Any thread.
std::string capture_metrics(const ApiContext& api, Format format);

}  // namespace kinevox::metrics
