// Decides in a live capture whether the segmentation judges faint blocks, too.
#pragma once

#include <cstdint>
#include <deque>
#include <optional>
#include <span>

#include "server/quality/judges.h"

namespace kinevox::quality {

// Silhouettes whose parts are all there fit the posed body better: eight shared sequences and nine trials of
// the sweep with complete silhouettes are at 6 to 14 mm, one without shoes at 15, six trials with missing
// limbs at 17 to 31.
inline constexpr double kMaxContourResidual_m = 0.013;

// Whether missing parts of a subject can be why they do not fit: no other cause comes first.
bool may_lack_parts(std::span<const Cause> causes);

// Where the posed bodies do not fit the silhouettes, SegmentationOptions::judge_faint is tried for some
// seconds, and kept if they then fit better: it takes soft shadows for the subject. Not thread safe.
class FaintSwitch {
  public:
    enum class Change { kNone, kTry, kKeep, kRevert };

    // Once per frame set. `residuals_m`: BodyPose::contour_residual_rms_m of the subjects whose body was
    // fitted to such silhouettes; another body may fit neither. `explained`: something else explains that
    // they do not fit.
    Change update(std::int64_t time_ns, std::span<const double> residuals_m, bool explained);

    bool judges_faint() const { return state_ != State::kPlain; }
    // Medians over some seconds, m: before the last change and at it.
    double residual_before_m() const { return before_m_; }
    double residual_after_m() const { return after_m_; }

  private:
    enum class State { kPlain, kTrial, kKept };
    struct Residual {
        std::int64_t time_ns;
        double residual_m;
    };
    std::optional<double> median_m() const;
    Change revert(std::int64_t time_ns);

    State state_ = State::kPlain;
    std::deque<Residual> latest_;
    std::int64_t last_ns_ = 0, trial_since_ns_ = 0, next_trial_ns_ = 0;
    double wait_s_ = 0;
    double before_m_ = 0, after_m_ = 0;
};

}  // namespace kinevox::quality
