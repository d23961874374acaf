#include "server/api/capture_service.h"

#include <boost/asio/post.hpp>

#include "server/api/capture_handlers.h"
#include "server/api/stream_reactor.h"
#include "server/api/to_proto.h"
#include "server/api/unary_call.h"

namespace kinevox {
namespace {

using EventReactor = StreamReactor<EventMailbox, v1::WatchEventsResponse>;

// Every daemon captures.
absl::Status always(const ApiContext&) {
    return absl::OkStatus();
}

}  // namespace

CaptureServiceImpl::Reactor* CaptureServiceImpl::GetStatus(Context* context, const v1::GetStatusRequest*,
                                                           v1::GetStatusResponse* response) {
    return answer(context, get_status(api_, *response));
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::ListCameras(Context* context,
                                                             const v1::ListCamerasRequest* request,
                                                             v1::ListCamerasResponse* response) {
    return answer(context, list_cameras(api_, *request, *response));
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::StartCapture(Context* context,
                                                              const v1::StartCaptureRequest* request,
                                                              v1::StartCaptureResponse* response) {
    return unary_call(api_, api_.control, context, request, response, always, start_capture);
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::StopCapture(Context* context,
                                                             const v1::StopCaptureRequest* request,
                                                             v1::StopCaptureResponse* response) {
    return unary_call(api_, api_.control, context, request, response, always, stop_capture);
}

// Its handler finishes later than it returns.
CaptureServiceImpl::Reactor* CaptureServiceImpl::LearnBackground(Context* context,
                                                                 const v1::LearnBackgroundRequest* request,
                                                                 v1::LearnBackgroundResponse*) {
    Reactor* reactor = context->DefaultReactor();
    boost::asio::post(api_.control, [this, reactor, request = *request] {
        learn_background(api_, request, [reactor](absl::Status status) { reactor->Finish(to_grpc(status)); });
    });
    return reactor;
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::AcquireControl(Context* context,
                                                                const v1::AcquireControlRequest* request,
                                                                v1::AcquireControlResponse* response) {
    return answer(context, acquire_control(api_, *request, *response));
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::RenewControl(Context* context,
                                                              const v1::RenewControlRequest* request,
                                                              v1::RenewControlResponse* response) {
    return answer(context, renew_control(api_, *request, *response));
}

CaptureServiceImpl::Reactor* CaptureServiceImpl::ReleaseControl(Context* context,
                                                                const v1::ReleaseControlRequest* request,
                                                                v1::ReleaseControlResponse* response) {
    return answer(context, release_control(api_, *request, *response));
}

grpc::ServerWriteReactor<v1::WatchEventsResponse>* CaptureServiceImpl::WatchEvents(
    Context* context, const v1::WatchEventsRequest* request) {
    if (const absl::Status bad = check_watch_events(*request); !bad.ok())
        return EventReactor::refuse(api_, to_grpc(bad));
    return EventReactor::run(
        api_, context, {},
        [this,
         history_count = static_cast<std::size_t>(request->history_count())](std::function<void()> on_ready) {
            return api_.hub.events().subscribe(history_count, std::move(on_ready));
        },
        [](const EventMailbox::Taken& taken) { return to_proto(taken.message, taken.missed); });
}

}  // namespace kinevox
