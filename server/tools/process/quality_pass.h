// How far the results of a run can be trusted.
#pragma once

#include <filesystem>
#include <vector>

#include "server/pipeline/frame_result.h"
#include "server/quality/observer.h"
#include "server/quality/verdict.h"
#include "server/recording/subject_names.h"
#include "server/tools/process/pose_pass.h"

namespace kinevox {

class QualityPass {
  public:
    QualityPass(std::filesystem::path session_file, const std::vector<Camera>& cameras,
                const std::vector<std::vector<Image>>& background, bool judge_faint = false)
        : session_file_(std::move(session_file)),
          observer_(cameras, background, {.judge_faint = judge_faint}) {}

    // Every frame set, in order.
    void add(const FrameResult& result) { observer_.add(result); }
    // Without a verdict: of each followed subject; one without poses.
    std::vector<quality::Measurements> measure(const PosePass* poses, const std::vector<PoseRow>& rows) const;
    // `poses` and its `rows` after finish(); null without poses. May read the session's videos again, to find
    // a cause.
    quality::QualityReport finish(const PosePass* poses, const std::vector<PoseRow>& rows,
                                  const SubjectNames& names = {}) const;

  private:
    std::filesystem::path session_file_;
    quality::Observer observer_;
};

}  // namespace kinevox
