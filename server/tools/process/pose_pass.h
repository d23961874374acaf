// The poses of a recording: fits the body to its first seconds, tracks these again with that body, and
// smooths the whole recording at the end.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstddef>
#include <memory>
#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/pipeline/frame_result.h"
#include "server/pose/body_fitter.h"
#include "server/pose/body_model.h"
#include "server/pose/pose_options.h"
#include "server/recording/csv_tables.h"

namespace kinevox {

class PoseStage;
struct PoseObservation;

struct PosePassOptions {
    double cutoff_hz = 6;     // of the zero-phase filter; 0: off
    double body_seconds = 6;  // of movement to which the body is fitted
    bool fit_body = true;     // false: the pipeline's body is used
    // Frame sets held in memory and tracked in both directions with the fitted body; later ones are tracked
    // once.
    std::size_t max_held_frame_sets = 1200;
    BodyFitOptions body;
};

class PosePass {
  public:
    // `posing`: the pipeline's.
    PosePass(std::vector<Camera> cameras, double fps, const PoseStageOptions& posing,
             const PosePassOptions& options);
    ~PosePass();

    // After each frame set of the pipeline; `stage` is the pipeline's.
    void add(const FrameResult& result, PoseStage& stage);
    // All frames, filtered, in order.
    std::vector<PoseRow> finish(PoseStage& stage);
    // Of the subject; nullopt before finish() or if no subject was found.
    const std::optional<BodyShape>& body() const { return body_; }
    // The body was given, not fitted; then it is also fitted to the movement, to compare.
    bool body_given() const { return !options_.fit_body; }
    const std::optional<BodyFit>& fit() const { return fit_; }

  private:
    struct Frame {
        PoseRow row;
        std::optional<BodyPosture> posture;
        std::unique_ptr<PoseObservation> observation;
    };
    void fit_and_retrack(PoseStage& stage);
    std::optional<BodyFit> fit_to_movement(const PoseStage& stage) const;

    std::vector<Camera> cameras_;
    double fps_;
    PoseStageOptions posing_;
    PosePassOptions options_;
    std::vector<Frame> frames_;
    bool retracked_ = false;  // the held frame sets were
    std::optional<BodyShape> body_;
    std::optional<BodyFit> fit_;
};

}  // namespace kinevox
