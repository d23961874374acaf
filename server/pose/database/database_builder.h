// Fills a pose database: poses are rendered from all around, and their silhouettes described by moments.
// About 20000 views a second and core.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <functional>
#include <span>
#include <stop_token>
#include <string>
#include <vector>

#include "kernels/types.h"
#include "server/pose/database/pose_database.h"

namespace kinevox {

// The kinds of viewpoint that the cameras have on a person anywhere where at least two (or the only one) see
// them.
std::vector<Viewpoint> viewpoints_of(std::span<const kernels::CameraModel> cameras,
                                     const PoseDatabaseOptions& options);

// What a database for these cameras, this body and these options would carry as its fingerprint.
std::string database_fingerprint(std::span<const kernels::CameraModel> cameras, const BodyShape& shape,
                                 const PoseDatabaseOptions& options);

// Gets the part done, 0 to 1, from a building thread, each time it has grown by about a percent.
using BuildProgress = std::function<void(double)>;

// What a user changed, kept when a database is built anew.
struct UserChanges {
    std::vector<LibraryPose> added;
    std::vector<std::string> removed;  // labels of the own library
};
UserChanges user_changes(const PoseDatabase& database);

// The own library with the user's changes. Cancelled if `stop` says so, InvalidArgument for options or
// cameras that cannot be used.
absl::StatusOr<PoseDatabase> build_pose_database(std::span<const kernels::CameraModel> cameras,
                                                 const BodyShape& shape, const PoseDatabaseOptions& options,
                                                 const UserChanges& changes = {},
                                                 const BuildProgress& progress = {},
                                                 std::stop_token stop = {});

// Adds a user's poses to a database that is there. The heading of their coordinates and the root's place do
// not matter. InvalidArgument for coordinates that are not finite or an empty label; Cancelled if `stop` says
// so, the database is then of no use.
absl::Status add_poses(PoseDatabase& database, std::span<const LibraryPose> poses, std::stop_token stop = {});

}  // namespace kinevox
