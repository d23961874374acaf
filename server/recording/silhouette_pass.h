// A recorded session's silhouettes, as the pipeline computes them.
#pragma once

#include <absl/status/status.h>

#include <cstdint>
#include <functional>

#include "common/session_file.h"
#include "server/pipeline/frame_result.h"
#include "server/recording/job_control.h"

namespace kinevox {

struct SilhouettePassOptions {
    std::int64_t frame_sets = 0;  // from the first
    bool one_thread = false;      // besides the decoders': next to a running capture
};

// Passes each frame set's result to `take`, in order, without poses; stops at its first error.
// FailedPrecondition if a camera has no background; Cancelled after `work.stop`; errors of reading.
absl::Status find_silhouettes(const Session& session, const SilhouettePassOptions& options,
                              const std::function<absl::Status(const FrameResult&)>& take,
                              const JobControl& work);

}  // namespace kinevox
