// Options of the smallest pose database.
#pragma once

#include "server/pose/database/pose_database.h"

namespace kinevox::testing {

inline PoseDatabaseOptions small_pose_options() {
    PoseDatabaseOptions options;
    options.poses = 1;
    options.order = 2;
    options.side_px = 32;
    options.elevation_step_deg = 45;
    options.inverse_distance_step = 2;
    return options;
}

}  // namespace kinevox::testing
