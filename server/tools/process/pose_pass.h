// The poses of a recording: fits the body to its first seconds, tracks these again with that body, and
// smooths the whole recording at the end.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "common/camera.h"
#include "server/pipeline/frame_result.h"
#include "server/pose/body_fitter.h"
#include "server/pose/body_model.h"
#include "server/pose/pose_options.h"
#include "server/pose/retrack.h"
#include "server/recording/csv_tables.h"

namespace kinevox {

class Pipeline;
struct PipelineOptions;
struct PoseObservation;

struct PosePassOptions {
    double cutoff_hz = 6;     // of the zero-phase filter, see applied_cutoff_hz(); 0: off
    double body_seconds = 6;  // of movement to which the body is fitted
    bool fit_body = true;     // false: the pipeline's body is used
    // Frame sets of a subject that are held in memory and tracked in both directions with the fitted body;
    // later ones are tracked once.
    std::size_t max_held_frame_sets = 1200;
    int searches = kRetrackRounds;  // of other postures, in these
    BodyFitOptions body;
};

class PosePass {
  public:
    // Each subject has a body of its own. Where the pipeline follows a lone one, who is there too briefly for
    // a body has that of the subject seen in most frames: it may be the same person, not recognised.
    PosePass(std::vector<Camera> cameras, double fps, const PipelineOptions& pipeline,
             const PosePassOptions& options);
    ~PosePass();

    // After each frame set of the pipeline.
    void add(const FrameResult& result, Pipeline& pipeline);
    // All frames, filtered, in order; those of one frame in the order of the subjects' ids.
    std::vector<PoseRow> finish(Pipeline& pipeline);
    // Of the subject; null before finish() or if no subject was found. With several, of the one that was
    // seen in most frames.
    const BodyShape* body() const;
    // Of the subject with this id, 0: as body(); null: none.
    const BodyShape* body_of(std::uint32_t subject_id) const;
    // The body was given, not fitted; then it is also fitted to the movement, to compare.
    bool body_given() const { return !options_.fit_body; }
    const BodyFit* fit_of(std::uint32_t subject_id) const;
    // Those seen in a tenth of the frames or more, else the one seen in most. 0: a lone one, by any id.
    std::vector<std::uint32_t> followed_subjects() const;
    // Whether rules exclude other people.
    bool subjects_selected() const { return selected_; }

  private:
    struct Frame {
        PoseRow row;
        std::optional<BodyPosture> posture;
        std::unique_ptr<PoseObservation> observation;
    };
    struct Subject {
        std::uint32_t id = 0;
        std::size_t first = 0;      // frame
        std::vector<Frame> frames;  // from `first` on
        bool retracked = false;     // the held frame sets were
        std::size_t seen_count = 0;
        std::optional<BodyShape> body;
        std::optional<BodyFit> fit;
    };
    Subject& subject_of(std::uint32_t id);
    const Subject* find(std::uint32_t id) const;
    const Subject* main() const;  // null before the first
    bool is_brief(const Subject& subject) const;
    void fit_and_retrack(Subject& subject, Pipeline& pipeline) const;
    std::optional<BodyFit> fit_to_movement(const Subject& subject) const;
    std::vector<PoseRow> rows_of(const Subject& subject) const;

    std::vector<Camera> cameras_;
    double fps_;
    PoseStageOptions posing_;
    PosePassOptions options_;
    bool lone_, selected_;
    std::vector<PoseRow> all_;  // per frame, without subject
    std::vector<std::unique_ptr<Subject>> subjects_;
};

// How well the posed bodies of a session fit their silhouettes, to choose between two runs.
struct PoseFitSummary {
    // Of each subject's poses the median: the mean over all poses, and the largest of those who have many.
    std::optional<double> contour_residual_m, max_contour_residual_m;
    std::int64_t measured_joints = 0;  // of all subjects, without those withheld
};

PoseFitSummary summarize(std::span<const PoseRow> rows);

// Shadows taken for the subject fit no body either, so the residual decides between two silhouettes of the
// same session, together with the joints that only the other measures.
bool is_better(const PoseFitSummary& one, const PoseFitSummary& other);

}  // namespace kinevox
