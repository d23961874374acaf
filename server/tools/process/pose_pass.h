// The poses of a recording: the body fitted to its first seconds, its frame sets followed again with that
// body, smoothed as a whole at the end.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/pipeline/frame_result.h"
#include "server/pose/body_model.h"
#include "server/pose/pose_options.h"
#include "server/recording/pose_tables.h"

namespace kinevox {

class PoseStage;
struct PoseObservation;

struct PosePassOptions {
    double cutoff_hz = 6;     // of the zero-phase filter; 0: none
    double body_seconds = 6;  // of movement, from which the body is fitted
    bool fit_body = true;     // else the pipeline's body is the subject's
    // So many frame sets are kept and followed both ways with the fitted body; those after them are followed
    // once.
    std::size_t max_kept = 1200;
    BodyFitOptions body;
};

class PosePass {
  public:
    // `posing` as the pipeline's.
    PosePass(std::vector<Camera> cameras, double fps, const PoseStageOptions& posing,
             const PosePassOptions& options);
    ~PosePass();

    // After each frame set of the pipeline; `stage` is the pipeline's.
    void add(const FrameResult& result, PoseStage& stage);
    // All frames, filtered, in the order they came.
    std::vector<PoseRow> finish(PoseStage& stage);
    // Of the subject; nothing before finish() or where nobody was found.
    const std::optional<BodyShape>& body() const { return body_; }

  private:
    struct Frame {
        PoseRow row;
        std::uint32_t subject_id = 0;
        std::optional<BodyPosture> posture;
        std::unique_ptr<PoseObservation> seen;
    };
    void settle(PoseStage& stage);

    std::vector<Camera> cameras_;
    double fps_;
    PoseStageOptions posing_;
    PosePassOptions options_;
    std::vector<Frame> frames_;
    bool settled_ = false;  // the kept frame sets were followed
    std::optional<BodyShape> body_;
};

}  // namespace kinevox
