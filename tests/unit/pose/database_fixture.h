// One small pose database for all tests of it.
#pragma once

#include <cstdlib>
#include <iostream>

#include "server/pose/database/database_builder.h"
#include "tests/support/database_queries.h"

namespace kinevox {

inline PoseDatabaseOptions small_options(int poses = 700) {
    PoseDatabaseOptions options;
    options.poses = poses;
    options.threads = 2;
    return options;
}

inline PoseDatabase built(std::span<const kernels::CameraModel> cameras, const PoseDatabaseOptions& options) {
    auto database = build_pose_database(cameras, default_body_shape(), options);
    if (!database.ok()) {
        std::cerr << database.status() << "\n";
        std::abort();
    }
    return *std::move(database);
}

inline const PoseDatabase& room_database() {
    static const PoseDatabase database = built(room_cameras(), small_options());
    return database;
}

}  // namespace kinevox
