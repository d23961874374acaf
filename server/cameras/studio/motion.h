// Motions of the virtual studio's person: a pose for every time.
#pragma once

#include <absl/status/statusor.h>

#include <memory>
#include <string>
#include <string_view>

#include "server/cameras/studio/rig.h"

namespace kinevox::studio {

inline constexpr std::array<std::string_view, 6> kMotionNames{"walk",  "run",          "sprint_start",
                                                              "squat", "jumping_jack", "arm_raise"};

enum class Stage {
    kRoom,
    kLane
};  // a room of 10 m x 9 m about the origin; a hall with a lane, x 0..12, y -1..1

class Motion {
  public:
    virtual ~Motion() = default;
    // Any time >= 0; continuous except at the end of each period if period_s() > 0.
    virtual Pose pose(double time_s) const = 0;
    // Time after which the motion restarts with a jump in position; 0: it never jumps.
    virtual double period_s() const = 0;
};

// The stage that suits the motion.
Stage natural_stage(std::string_view motion);

// InvalidArgument for an unknown name. `rig` must outlive the motion.
absl::StatusOr<std::unique_ptr<Motion>> make_motion(std::string_view name, Stage stage, const Rig& rig);

// Factories.
std::unique_ptr<Motion> make_gait(bool run, Stage stage, const Rig& rig);  // gait_motion.cc
std::unique_ptr<Motion> make_sprint_start(const Rig& rig);                 // sprint_motion.cc
std::unique_ptr<Motion> make_squat(const Rig& rig);                        // exercise_motions.cc
std::unique_ptr<Motion> make_jumping_jack(const Rig& rig);
std::unique_ptr<Motion> make_arm_raise(const Rig& rig);

}  // namespace kinevox::studio
