#include "server/api/replay_service.h"

#include <boost/asio/post.hpp>

#include "server/api/replay_handlers.h"
#include "server/api/to_proto.h"

namespace kinevox {
namespace {

// gRPC keeps request and response until Finish().
template <typename Request, typename Response>
grpc::ServerUnaryReactor* on_control(const ApiContext& api, grpc::CallbackServerContext* context, const Request* request,
                                     Response* response,
                                     absl::Status (*handler)(const ApiContext&, const Request&, Response&)) {
    grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
    boost::asio::post(api.control, [&api, reactor, request, response, handler] {
        reactor->Finish(to_grpc(handler(api, *request, *response)));
    });
    return reactor;
}

grpc::ServerUnaryReactor* answer(grpc::CallbackServerContext* context, const absl::Status& status) {
    grpc::ServerUnaryReactor* reactor = context->DefaultReactor();
    reactor->Finish(to_grpc(status));
    return reactor;
}

}  // namespace

ReplayServiceImpl::Reactor* ReplayServiceImpl::OpenReplay(Context* context, const v1::OpenReplayRequest* request,
                                                          v1::OpenReplayResponse* response) {
    return on_control(api_, context, request, response, open_replay);
}

ReplayServiceImpl::Reactor* ReplayServiceImpl::CloseReplay(Context* context, const v1::CloseReplayRequest* request,
                                                           v1::CloseReplayResponse* response) {
    return on_control(api_, context, request, response, close_replay);
}

ReplayServiceImpl::Reactor* ReplayServiceImpl::SetReplay(Context* context, const v1::SetReplayRequest* request,
                                                         v1::SetReplayResponse* response) {
    return answer(context, set_replay(api_, *request, *response));
}

ReplayServiceImpl::Reactor* ReplayServiceImpl::GetReplay(Context* context, const v1::GetReplayRequest* request,
                                                         v1::GetReplayResponse* response) {
    return answer(context, get_replay(api_, *request, *response));
}

}  // namespace kinevox
