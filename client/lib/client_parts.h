// Internal to client/lib: the stubs behind Client, the forms that its calls have, and held control.
#pragma once

#include <absl/status/statusor.h>
#include <grpcpp/grpcpp.h>

#include <condition_variable>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>

#include "client/lib/client.h"
#include "client/lib/connection.h"
#include "kinevox/v1/calibration_service.grpc.pb.h"
#include "kinevox/v1/capture_service.grpc.pb.h"
#include "kinevox/v1/pose_service.grpc.pb.h"
#include "kinevox/v1/recording_service.grpc.pb.h"
#include "kinevox/v1/replay_service.grpc.pb.h"
#include "kinevox/v1/stream_service.grpc.pb.h"

namespace kinevox::client {

// Of calls that render, write or load files, or restart the capture.
inline constexpr std::chrono::milliseconds kChangeTimeout{120'000};

struct Client::Parts {
    ClientOptions options;
    std::shared_ptr<grpc::Channel> channel;
    std::unique_ptr<v1::CaptureService::Stub> capture;
    std::unique_ptr<v1::StreamService::Stub> stream;
    std::unique_ptr<v1::PoseService::Stub> pose;
    std::unique_ptr<v1::CalibrationService::Stub> calibration;
    std::unique_ptr<v1::RecordingService::Stub> recording;
    std::unique_ptr<v1::ReplayService::Stub> replay;

    // One unary call.
    template <typename Stub, typename Request, typename Response>
    absl::StatusOr<Response> call(
        Stub& stub, grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&, Response*),
        const Request& request, std::optional<std::chrono::milliseconds> timeout = {}) {
        grpc::ClientContext context;
        prepare_context(context, options);
        context.set_deadline(std::chrono::system_clock::now() + timeout.value_or(options.timeout));
        Response response;
        const grpc::Status status = (stub.*method)(&context, request, &response);
        if (!status.ok()) return to_absl(status, options);
        return response;
    }

    // A list: all pages in one response.
    template <typename Stub, typename Request, typename Response>
    absl::StatusOr<Response> call_all_pages(Stub& stub,
                                            grpc::Status (Stub::*method)(grpc::ClientContext*, const Request&,
                                                                         Response*),
                                            Request request) {
        absl::StatusOr<Response> all = call(stub, method, request);
        while (all.ok() && !all->next_page_token().empty()) {
            request.set_page_token(all->next_page_token());
            const auto page = call(stub, method, request);
            if (!page.ok()) return page.status();
            all->clear_next_page_token();
            all->MergeFrom(*page);  // appends the repeated fields
        }
        return all;
    }

    // A server stream of messages that are passed on as they are.
    template <typename Prepare, typename Message>
    absl::Status read(const Prepare& prepare, const std::function<bool(const Message&)>& on_message,
                      const StreamOptions& stream_options) {
        return read_stream<Message>(
            prepare, [&](const Message& message) -> absl::StatusOr<bool> { return on_message(message); },
            stream_options, options);
    }
};

// Under control of its own, unless the request carries a lease_id and `keep_lease` says to use it.
template <typename Response, typename Request, typename Call>
absl::StatusOr<Response> change_under_control(Client& client, const std::string& operator_name,
                                              Request& request, const Call& call, bool keep_lease = false) {
    if (keep_lease && !request.lease_id().empty()) return call();
    absl::StatusOr<Response> response;
    const absl::Status status = client.with_control(operator_name, [&](const Lease& lease) {
        request.set_lease_id(lease.id);
        response = call();
        return response.status();
    });
    if (!status.ok()) return status;
    return response;
}

// Control of the daemon for the lifetime of an object, the one lease policy of all clients: a lease of 30 s,
// so that control is free again soon after a client crashes; renewed at a third of it by a thread of its own,
// released by the destructor. `client` must outlive it.
class HeldControl {
  public:
    static absl::StatusOr<std::unique_ptr<HeldControl>> acquire(Client& client,
                                                                const std::string& operator_name);
    ~HeldControl();
    HeldControl(const HeldControl&) = delete;
    HeldControl& operator=(const HeldControl&) = delete;

    const Lease& lease() const { return lease_; }

  private:
    HeldControl(Client& client, Lease lease, std::chrono::milliseconds timeout);

    Client& client_;
    const Lease lease_;
    std::mutex mutex_;
    std::condition_variable_any stopped_;
    std::jthread renewal_;
};

}  // namespace kinevox::client
