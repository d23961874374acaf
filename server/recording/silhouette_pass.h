// A recorded session's silhouettes, as the pipeline finds them.
#pragma once

#include <absl/status/status.h>

#include <cstdint>
#include <functional>

#include "common/session_file.h"
#include "server/pipeline/frame_result.h"
#include "server/recording/long_work.h"

namespace kinevox {

struct SilhouettePassOptions {
    std::int64_t frame_sets = 0;  // that are wanted, from the first
    bool one_thread = false;      // the caller's and those that decode: beside a running capture
};

// Gives each frame set's result to `take`, in their order, without poses; stops with its first error.
// FailedPrecondition where a camera has no background; Cancelled after `work.stop`; else what reading says.
absl::Status find_silhouettes(const Session& session, const SilhouettePassOptions& options,
                              const std::function<absl::Status(const FrameResult&)>& take,
                              const LongWork& work);

}  // namespace kinevox
