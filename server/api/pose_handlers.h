// Handlers of PoseService, one function per method: check, act, translate. Those that change the database
// block and run on its thread for changes, after check_pose_database().
#pragma once

#include <absl/status/status.h>

#include "kinevox/v1/pose_service.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

// FailedPrecondition if this daemon has no pose database.
absl::Status check_pose_database(const ApiContext& api);

absl::Status list_library_poses(const ApiContext& api, const v1::ListLibraryPosesRequest& request,
                                v1::ListLibraryPosesResponse& response);
absl::Status add_library_pose(const ApiContext& api, const v1::AddLibraryPoseRequest& request,
                              v1::AddLibraryPoseResponse& response);
absl::Status delete_library_pose(const ApiContext& api, const v1::DeleteLibraryPoseRequest& request,
                                 v1::DeleteLibraryPoseResponse& response);
absl::Status import_library_poses(const ApiContext& api, const v1::ImportLibraryPosesRequest& request,
                                  v1::ImportLibraryPosesResponse& response);
v1::WatchPoseDatabaseResponse to_proto(const DatabaseProgress& progress);

// FailedPrecondition if this daemon measures no poses.
absl::Status check_body_fit(const ApiContext& api);
absl::Status fit_body(const ApiContext& api, const v1::FitBodyRequest& request);
// The body of the tracked subject, or the default body.
v1::WatchBodyResponse body_to_proto(const ApiContext& api, const BodyFitProgress& progress);

}  // namespace kinevox
