#include "server/api/pose_service.h"

#include "server/api/pose_handlers.h"
#include "server/api/stream_reactor.h"
#include "server/api/to_proto.h"
#include "server/api/unary_call.h"

namespace kinevox {

using DatabaseReactor = StreamReactor<DatabaseWatch::Box, v1::WatchPoseDatabaseResponse>;
using BodyReactor = StreamReactor<BodyWatch::Box, v1::WatchBodyResponse>;

PoseServiceImpl::Reactor* PoseServiceImpl::ListLibraryPoses(Context* context,
                                                            const v1::ListLibraryPosesRequest* request,
                                                            v1::ListLibraryPosesResponse* response) {
    return answer(context, list_library_poses(api_, *request, *response));
}

PoseServiceImpl::Reactor* PoseServiceImpl::AddLibraryPose(Context* context,
                                                          const v1::AddLibraryPoseRequest* request,
                                                          v1::AddLibraryPoseResponse* response) {
    return unary_call(api_, api_.changes, context, request, response, check_pose_database, add_library_pose);
}

PoseServiceImpl::Reactor* PoseServiceImpl::DeleteLibraryPose(Context* context,
                                                             const v1::DeleteLibraryPoseRequest* request,
                                                             v1::DeleteLibraryPoseResponse* response) {
    return unary_call(api_, api_.changes, context, request, response, check_pose_database,
                      delete_library_pose);
}

PoseServiceImpl::Reactor* PoseServiceImpl::ImportLibraryPoses(Context* context,
                                                              const v1::ImportLibraryPosesRequest* request,
                                                              v1::ImportLibraryPosesResponse* response) {
    return unary_call(api_, api_.changes, context, request, response, check_pose_database,
                      import_library_poses);
}

grpc::ServerWriteReactor<v1::WatchPoseDatabaseResponse>* PoseServiceImpl::WatchPoseDatabase(
    Context* context, const v1::WatchPoseDatabaseRequest*) {
    if (const absl::Status missing = check_pose_database(api_); !missing.ok())
        return DatabaseReactor::refuse(api_, to_grpc(missing));
    return DatabaseReactor::run(
        api_, context, {},
        [this](std::function<void()> on_ready) { return api_.pose_watch->subscribe(std::move(on_ready)); },
        [](const DatabaseWatch::Box::Taken& taken) { return to_proto(taken.message); });
}

PoseServiceImpl::Reactor* PoseServiceImpl::FitBody(Context* context, const v1::FitBodyRequest* request,
                                                   v1::FitBodyResponse*) {
    return answer(context, fit_body(api_, *request));
}

grpc::ServerWriteReactor<v1::WatchBodyResponse>* PoseServiceImpl::WatchBody(Context* context,
                                                                            const v1::WatchBodyRequest*) {
    if (const absl::Status missing = check_body_fit(api_); !missing.ok())
        return BodyReactor::refuse(api_, to_grpc(missing));
    return BodyReactor::run(
        api_, context, {},
        [this](std::function<void()> on_ready) { return api_.body_watch->subscribe(std::move(on_ready)); },
        [this](const BodyWatch::Box::Taken& taken) { return body_to_proto(api_, taken.message); });
}

}  // namespace kinevox
