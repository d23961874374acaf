#include "server/api/pose_service.h"

#include <boost/asio/post.hpp>

#include "server/api/pose_handlers.h"
#include "server/api/stream_reactor.h"
#include "server/api/to_proto.h"

namespace kinevox {

using DatabaseReactor = StreamReactor<DatabaseWatch::Box, v1::WatchDatabaseResponse>;
using BodyReactor = StreamReactor<BodyWatch::Box, v1::WatchBodyResponse>;

// gRPC keeps request and response until Finish().
template <typename Request, typename Response>
PoseServiceImpl::Reactor* PoseServiceImpl::change(Context* context, const Request* request, Response* response,
                                                  absl::Status (*handler)(const ApiContext&, const Request&,
                                                                          Response&)) {
    Reactor* reactor = context->DefaultReactor();
    if (const absl::Status missing = check_pose_database(api_); !missing.ok()) {
        reactor->Finish(to_grpc(missing));
        return reactor;
    }
    boost::asio::post(api_.changes, [this, reactor, request, response, handler] {
        reactor->Finish(to_grpc(handler(api_, *request, *response)));
    });
    return reactor;
}

PoseServiceImpl::Reactor* PoseServiceImpl::ListPoses(Context* context, const v1::ListPosesRequest*,
                                                     v1::ListPosesResponse* response) {
    Reactor* reactor = context->DefaultReactor();
    reactor->Finish(to_grpc(list_poses(api_, *response)));
    return reactor;
}

PoseServiceImpl::Reactor* PoseServiceImpl::AddPose(Context* context, const v1::AddPoseRequest* request,
                                                   v1::AddPoseResponse* response) {
    return change(context, request, response, add_pose);
}

PoseServiceImpl::Reactor* PoseServiceImpl::RemovePose(Context* context, const v1::RemovePoseRequest* request,
                                                      v1::RemovePoseResponse* response) {
    return change(context, request, response, remove_pose);
}

PoseServiceImpl::Reactor* PoseServiceImpl::ImportBvh(Context* context, const v1::ImportBvhRequest* request,
                                                     v1::ImportBvhResponse* response) {
    return change(context, request, response, import_bvh);
}

grpc::ServerWriteReactor<v1::WatchDatabaseResponse>* PoseServiceImpl::WatchDatabase(Context*,
                                                                                    const v1::WatchDatabaseRequest*) {
    if (const absl::Status missing = check_pose_database(api_); !missing.ok())
        return DatabaseReactor::refuse(api_, to_grpc(missing));
    return DatabaseReactor::run(
        api_, 0, [this](std::function<void()> on_ready) { return api_.pose_watch->subscribe(std::move(on_ready)); },
        [](const DatabaseWatch::Box::Taken& taken) { return to_proto(taken.message); });
}

PoseServiceImpl::Reactor* PoseServiceImpl::FitBody(Context* context, const v1::FitBodyRequest* request,
                                                   v1::FitBodyResponse*) {
    Reactor* reactor = context->DefaultReactor();
    reactor->Finish(to_grpc(fit_body(api_, *request)));
    return reactor;
}

grpc::ServerWriteReactor<v1::WatchBodyResponse>* PoseServiceImpl::WatchBody(Context*, const v1::WatchBodyRequest*) {
    if (const absl::Status missing = check_body_fit(api_); !missing.ok())
        return BodyReactor::refuse(api_, to_grpc(missing));
    return BodyReactor::run(
        api_, 0, [this](std::function<void()> on_ready) { return api_.body_watch->subscribe(std::move(on_ready)); },
        [](const BodyWatch::Box::Taken& taken) { return to_proto(taken.message); });
}

}  // namespace kinevox
