// World frame and scale from a walking person.
#pragma once

#include <optional>
#include <vector>

#include "common/camera.h"
#include "server/calibration/triangulation.h"
#include "server/silhouettes/silhouette_set.h"

namespace kinevox {

struct PersonWorld {
    SimilarityTransform
        world_from_solved;     // world: floor z = 0, z up, origin below the subject's mean position
    double height_solved = 0;  // of the upright subject, in the cameras' units
    double way_long_m = 0,
           way_wide_m = 0;     // extent of the subject's positions on the floor, along and across
    double uneven_height = 1;  // upper over median height of the hulls
    int frame_sets = 0;
};

// `up_in_solved`: approximate. Empty for fewer than five hulls. The subject should walk upright with the arms
// down for some of the time.
std::optional<PersonWorld> person_world(const std::vector<Camera>& cameras, const SilhouetteSet& silhouettes,
                                        Vec3 up_in_solved, double height_m);

}  // namespace kinevox
