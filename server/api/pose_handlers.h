// PoseService's calls, one function each: check, act, translate. Those that change the database take their
// time and run on the thread for changes, after check_pose_database().
#pragma once

#include <absl/status/status.h>

#include "kinevox/v1/pose_service.pb.h"
#include "server/api/api_context.h"

namespace kinevox {

// FailedPrecondition where this daemon has no pose database.
absl::Status check_pose_database(const ApiContext& api);

absl::Status list_poses(const ApiContext& api, v1::ListPosesResponse& response);
absl::Status add_pose(const ApiContext& api, const v1::AddPoseRequest& request,
                      v1::AddPoseResponse& response);
absl::Status remove_pose(const ApiContext& api, const v1::RemovePoseRequest& request,
                         v1::RemovePoseResponse& response);
absl::Status import_bvh(const ApiContext& api, const v1::ImportBvhRequest& request,
                        v1::ImportBvhResponse& response);

// FailedPrecondition where this daemon measures no poses.
absl::Status check_body_fit(const ApiContext& api);
absl::Status fit_body(const ApiContext& api, const v1::FitBodyRequest& request);
v1::WatchBodyResponse to_proto(const BodyFitProgress& progress);

v1::WatchDatabaseResponse to_proto(const DatabaseProgress& progress);

}  // namespace kinevox
