// A recorded session through the pipeline, every frame set, no daemon.
#pragma once

#include <absl/status/status.h>

#include <atomic>
#include <filesystem>

#include "server/pipeline/pipeline.h"
#include "server/tools/process/pose_pass.h"
#include "server/tools/process/result_writer.h"

namespace kinevox {

struct ProcessOptions {
    std::filesystem::path session_file, out_folder;
    std::filesystem::path
        tpose_file;  // session of the same person in a T-pose, for the body; empty: from the movement
    PipelineOptions pipeline;
    ResultWriterOptions writer;
    PosePassOptions poses;
    int max_frames = 0;            // stops after so many frame sets; 0: all
    bool decode_in_bursts = true;  // see SessionSourceOptions
    bool quiet = false;            // no progress bar, no summary
    bool resume = false;  // results of the same input and options that are there already are left as they are
};

// Cancelled if `stop` becomes true; then, as after every error, nothing new lies in the output folder.
absl::Status process_session(const ProcessOptions& options, const std::atomic<bool>& stop);

}  // namespace kinevox
