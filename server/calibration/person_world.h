// Which way is up, where the floor is and how long a metre is, from a person who walked.
#pragma once

#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/calibration/silhouette_set.h"
#include "server/calibration/triangulation.h"

namespace kinevox {

struct PersonWorld {
    Alignment world_from_solved;  // world: floor z = 0, z up, origin under where the subject was on average
    double height_solved = 0;     // of the upright subject, in the cameras' own units
    double way_long_m = 0, way_wide_m = 0;  // extent of the subject's places on the floor, along and across
    double uneven_height = 1;               // upper over middle height of the hulls
    int moments = 0;
};

// `up_in_solved`: roughly. Nothing where fewer than five hulls are found. The subject should walk upright
// with the arms down for a part of the time.
std::optional<PersonWorld> person_world(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                                        Vec3 up_in_solved, double height_m);

}  // namespace kinevox
