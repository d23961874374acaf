#include "server/api/replay_service.h"

#include "server/api/replay_handlers.h"
#include "server/api/unary_call.h"

namespace kinevox {

ReplayServiceImpl::Reactor* ReplayServiceImpl::OpenReplay(Context* context,
                                                          const v1::OpenReplayRequest* request,
                                                          v1::OpenReplayResponse* response) {
    return unary_call(api_, api_.control, context, request, response, check_replay, open_replay);
}

ReplayServiceImpl::Reactor* ReplayServiceImpl::CloseReplay(Context* context,
                                                           const v1::CloseReplayRequest* request,
                                                           v1::CloseReplayResponse* response) {
    return unary_call(api_, api_.control, context, request, response, check_replay, close_replay);
}

ReplayServiceImpl::Reactor* ReplayServiceImpl::UpdateReplay(Context* context,
                                                            const v1::UpdateReplayRequest* request,
                                                            v1::UpdateReplayResponse* response) {
    return answer(context, update_replay(api_, *request, *response));
}

ReplayServiceImpl::Reactor* ReplayServiceImpl::GetReplay(Context* context,
                                                         const v1::GetReplayRequest* request,
                                                         v1::GetReplayResponse* response) {
    return answer(context, get_replay(api_, *request, *response));
}

}  // namespace kinevox
