#include "server/api/pose_service.h"

#include "server/api/pose_handlers.h"
#include "server/api/stream_reactor.h"
#include "server/api/to_proto.h"
#include "server/api/unary_call.h"

namespace kinevox {

using DatabaseReactor = StreamReactor<DatabaseWatch::Box, v1::WatchDatabaseResponse>;
using BodyReactor = StreamReactor<BodyWatch::Box, v1::WatchBodyResponse>;

PoseServiceImpl::Reactor* PoseServiceImpl::ListPoses(Context* context, const v1::ListPosesRequest*,
                                                     v1::ListPosesResponse* response) {
    return answer(context, list_poses(api_, *response));
}

PoseServiceImpl::Reactor* PoseServiceImpl::AddPose(Context* context, const v1::AddPoseRequest* request,
                                                   v1::AddPoseResponse* response) {
    return unary_call(api_, api_.changes, context, request, response, check_pose_database, add_pose);
}

PoseServiceImpl::Reactor* PoseServiceImpl::RemovePose(Context* context, const v1::RemovePoseRequest* request,
                                                      v1::RemovePoseResponse* response) {
    return unary_call(api_, api_.changes, context, request, response, check_pose_database, remove_pose);
}

PoseServiceImpl::Reactor* PoseServiceImpl::ImportBvh(Context* context, const v1::ImportBvhRequest* request,
                                                     v1::ImportBvhResponse* response) {
    return unary_call(api_, api_.changes, context, request, response, check_pose_database, import_bvh);
}

grpc::ServerWriteReactor<v1::WatchDatabaseResponse>* PoseServiceImpl::WatchDatabase(
    Context* context, const v1::WatchDatabaseRequest*) {
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
        [](const BodyWatch::Box::Taken& taken) { return to_proto(taken.message); });
}

}  // namespace kinevox
