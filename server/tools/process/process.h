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
        tpose_file;  // T-pose session of the same subject, to fit the body; empty: from the movement
    PipelineOptions pipeline;
    ResultWriterOptions writer;
    PosePassOptions poses;
    int every = 1;       // processes every Nth frame set, at that fraction of the rate
    int max_frames = 0;  // number of processed frame sets; 0: all
    // Without it, a session whose silhouettes may lack parts of a subject is processed again with
    // segmentation.judge_faint, and the run whose poses fit better is kept.
    bool single_run = false;
    bool decode_in_bursts = true;  // see SessionSourceOptions
    bool quiet = false;            // no progress bar, no summary
    bool resume = false;           // skip if the folder has results of the same input and options
    bool overwrite = false;        // replace other results; without it they are AlreadyExists
};

// Cancelled if `stop` becomes true; then, as after every error, the output folder is unchanged.
absl::Status process_session(const ProcessOptions& options, const std::atomic<bool>& stop);

}  // namespace kinevox
