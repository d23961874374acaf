// The poses of a recording: what the pipeline fitted frame by frame, smoothed as a whole at the end.
#pragma once

#include <optional>
#include <vector>

#include "server/pipeline/frame_result.h"
#include "server/pose/body_model.h"
#include "server/tools/process/pose_tables.h"

namespace kinevox {

class PoseStage;

struct PosePassOptions {
    double cutoff_hz = 6;    // of the zero-phase filter; 0: none
};

class PosePass {
  public:
    PosePass(double fps, const PosePassOptions& options) : fps_(fps), options_(options) {}

    // After each frame set of the pipeline; `stage` is the pipeline's.
    void add(const FrameResult& result, const PoseStage& stage);
    // All frames, filtered, in the order they came.
    std::vector<PoseRow> finish(const PoseStage& stage);

  private:
    struct Frame {
        PoseRow row;
        std::optional<BodyPosture> posture;
    };
    double fps_;
    PosePassOptions options_;
    std::vector<Frame> frames_;
};

}  // namespace kinevox
