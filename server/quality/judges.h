// One judge per cause. Each looks at the measurements and either recognises its cause or does not.
//
// The thresholds are in the judges' files; docs/quality.md lists them with the values measured on good and
// spoiled sessions.
#pragma once

#include <optional>
#include <string>

#include "server/quality/measurements.h"

namespace kinevox::quality {

enum class Trust { kGood, kCaution, kDoNotUse };

constexpr const char* to_text(Trust trust) {
    return trust == Trust::kGood ? "GOOD" : trust == Trust::kCaution ? "CAUTION" : "DO NOT USE";
}

struct Cause {
    Trust trust = Trust::kCaution;
    std::string cause;   // stable code, listed in docs/quality.md: "camera_moved", ...
    std::string camera;  // camera name, if it is about one camera
    std::string reason;  // one sentence
    std::string remedy;  // one sentence
};

// Silhouettes and calibration contradict each other enough to ask which camera causes it.
bool rig_is_inconsistent(const RigMeasurements& rig);

// A camera of another time may cause what contradicts itself in all or some frame sets.
bool time_is_doubtful(const RigMeasurements& rig);

// The silhouettes end above the floor and show too little for the fitted body: parts of it are missing.
bool lacks_lower_body(const Measurements& seen);

using Judgement = std::optional<Cause>;

Judgement judge_light(const Measurements& seen);         // too_dark, saturated
Judgement judge_background(const Measurements& seen);    // background_occupied
Judgement judge_people(const Measurements& seen);        // several_people
Judgement judge_still_object(const Measurements& seen);  // still_object
Judgement judge_time(const Measurements& seen);          // camera_time
Judgement judge_intrinsics(const Measurements& seen);    // intrinsics
Judgement judge_camera(const Measurements& seen);        // camera_moved, cameras_swapped
Judgement judge_world(const Measurements& seen);         // world_upside_down, world_tilted, floor_height
Judgement judge_scale(const Measurements& seen);         // scale
Judgement judge_view(const Measurements& seen);          // out_of_view, no_subject
Judgement judge_body(const Measurements& seen);          // wrong_body
Judgement judge_silhouettes(const Measurements& seen);   // silhouettes

}  // namespace kinevox::quality
