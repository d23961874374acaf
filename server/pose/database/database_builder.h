// Builds a pose database: renders poses from all directions and describes their silhouettes by moments. About
// 20000 views per second and core.
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

// The viewpoints of the cameras on a person at any position seen by at least two cameras (or the only one).
std::vector<Viewpoint> viewpoints_of(std::span<const kernels::CameraModel> cameras,
                                     const PoseDatabaseOptions& options);

// The fingerprint of a database for these cameras, this body and these options.
std::string database_fingerprint(std::span<const kernels::CameraModel> cameras, const BodyShape& shape,
                                 const PoseDatabaseOptions& options);

// Receives the progress, 0 to 1, from a building thread, about every percent.
using BuildProgress = std::function<void(double)>;

// A user's changes, kept when a database is rebuilt.
struct UserChanges {
    std::vector<LibraryPose> added;
    std::vector<std::string> removed;  // labels of library poses
};
UserChanges user_changes(const PoseDatabase& database);

// The library poses with the user's changes. Cancelled by `stop`, InvalidArgument for invalid options or
// cameras.
absl::StatusOr<PoseDatabase> build_pose_database(std::span<const kernels::CameraModel> cameras,
                                                 const BodyShape& shape, const PoseDatabaseOptions& options,
                                                 const UserChanges& changes = {},
                                                 const BuildProgress& progress = {},
                                                 std::stop_token stop = {});

// Adds a user's poses to a database. Heading and root position of their coordinates are ignored.
// InvalidArgument for coordinates that are not finite or an empty label; Cancelled by `stop`, the database is
// then invalid.
absl::Status add_poses(PoseDatabase& database, std::span<const LibraryPose> poses, std::stop_token stop = {});

}  // namespace kinevox
