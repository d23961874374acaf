// Of a result of several subjects, those that a trial has measured, and what the cameras show of them.
#pragma once

#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "common/camera.h"
#include "kernels/segmentation.h"
#include "server/pipeline/frame_result.h"
#include "server/recording/trial.h"

namespace kinevox {

// A repeated run of the pipeline may number the subjects differently: they are identified by their positions.
class SubjectMatcher {
  public:
    // `trials`: one per subject; must outlive this.
    explicit SubjectMatcher(std::span<const Trial> trials);

    struct Match {
        std::uint32_t id = 0;  // the trial's
        const SubjectResult* result = nullptr;
    };
    // Those of the trials, in the order of their ids. `frame`: of the session; increasing.
    std::vector<Match> match(const FrameResult& result, std::int64_t frame);

  private:
    std::uint32_t nearest(const SubjectResult& subject, std::int64_t frame) const;

    std::span<const Trial> trials_;
    std::vector<std::map<std::int64_t, std::size_t>> rows_;  // per trial, by frame of the session
    std::map<std::uint32_t, std::uint32_t> known_;           // the trial's id by the pipeline's
};

// The sharp silhouette's components that belong to the subjects' volumes: 0 or 255, of its size.
std::vector<std::uint8_t> silhouette_of(std::span<const SubjectMatcher::Match> subjects,
                                        const kernels::Silhouettes& silhouettes, const Camera& camera);

}  // namespace kinevox
