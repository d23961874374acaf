#include "server/api/api_server.h"

#include <fmt/format.h>
#include <grpcpp/ext/proto_server_reflection_plugin.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/health_check_service_interface.h>

#include "server/access/guard.h"
#include "server/api/calibration_service.h"
#include "server/api/call_access.h"
#include "server/api/capture_service.h"
#include "server/api/pose_service.h"
#include "server/api/recording_service.h"
#include "server/api/replay_service.h"
#include "server/api/stream_service.h"

namespace kinevox {

struct ApiServer::Parts {
    explicit Parts(const ApiContext& api)
        : guard(api.guard),
          capture(api),
          stream(api),
          pose(api),
          calibration(api),
          recording(api),
          replay(api) {}
    Guard* const guard;
    CaptureServiceImpl capture;
    StreamServiceImpl stream;
    PoseServiceImpl pose;
    CalibrationServiceImpl calibration;
    RecordingServiceImpl recording;
    ReplayServiceImpl replay;
    int port = 0;
    std::unique_ptr<grpc::Server> server;

    std::vector<grpc::Service*> services() {
        return {&capture, &stream, &pose, &calibration, &recording, &replay};
    }

    // Checks each call of all services.
    void set_guard(grpc::ServerBuilder& builder) {
        if (!guard) return;
        guard->set_services(
            {v1::CaptureService::service_full_name(), v1::StreamService::service_full_name(),
             v1::PoseService::service_full_name(), v1::CalibrationService::service_full_name(),
             v1::RecordingService::service_full_name(), v1::ReplayService::service_full_name()});
        if (!guard->audit()) return;
        std::vector<std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface>> interceptors;
        interceptors.push_back(audit_interceptors(*guard));
        builder.experimental().SetInterceptorCreators(std::move(interceptors));
    }

    void build(const std::string& address, const ApiServerOptions& options) {
        grpc::EnableDefaultHealthCheckService(true);
        grpc::reflection::InitProtoReflectionServerBuilderPlugin();
        grpc::ServerBuilder builder;
        for (grpc::Service* service : services()) builder.RegisterService(service);
        set_guard(builder);
        builder.AddChannelArgument(GRPC_ARG_ALLOW_REUSEPORT,
                                   0);  // a second daemon on the same port must fail
        // Detects a dead client within a minute.
        builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIME_MS, 30'000);
        builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_TIMEOUT_MS, 20'000);
        builder.AddChannelArgument(GRPC_ARG_HTTP2_MIN_RECV_PING_INTERVAL_WITHOUT_DATA_MS, 5'000);
        builder.AddChannelArgument(GRPC_ARG_KEEPALIVE_PERMIT_WITHOUT_CALLS, 1);
        // Closes connections without a handshake, and connections without calls.
        builder.AddChannelArgument(GRPC_ARG_SERVER_HANDSHAKE_TIMEOUT_MS,
                                   static_cast<int>(options.handshake_timeout.count()));
        builder.AddChannelArgument(GRPC_ARG_MAX_CONNECTION_IDLE_MS, 600'000);
        builder.AddChannelArgument(GRPC_ARG_ENABLE_CHANNELZ, 0);  // no access to its statistics
        builder.SetMaxReceiveMessageSize(options.max_request_bytes);
        if (!address.empty())
            builder.AddListeningPort(address, guarded_credentials(options.identity, guard), &port);
        server = builder.BuildAndStart();
    }
};

ApiServer::ApiServer(std::unique_ptr<Parts> parts) : parts_(std::move(parts)) {}

absl::StatusOr<std::unique_ptr<ApiServer>> ApiServer::listen(const std::string& address,
                                                             const ApiContext& api,
                                                             const ApiServerOptions& options) {
    auto parts = std::make_unique<Parts>(api);
    parts->build(address, options);
    if (!parts->server || parts->port == 0)
        return absl::UnavailableError(
            fmt::format("cannot listen on {}: the port is in use, or the address does not belong to this "
                        "machine; stop the "
                        "other program, or set another [server] listen",
                        address));
    std::unique_ptr<ApiServer> server(new ApiServer(std::move(parts)));
    server->set_serving(false);
    return server;
}

std::unique_ptr<ApiServer> ApiServer::in_process(const ApiContext& api) {
    auto parts = std::make_unique<Parts>(api);
    parts->build({}, {});
    return std::unique_ptr<ApiServer>(new ApiServer(std::move(parts)));
}

ApiServer::~ApiServer() {
    shutdown(std::chrono::milliseconds(0));
}

int ApiServer::port() const {
    return parts_->port;
}

void ApiServer::set_serving(bool serving) {
    if (auto* health = parts_->server->GetHealthCheckService()) health->SetServingStatus(serving);
}

std::shared_ptr<grpc::Channel> ApiServer::in_process_channel() {
    return parts_->server->InProcessChannel(grpc::ChannelArguments());
}

void ApiServer::shutdown(std::chrono::milliseconds grace) {
    if (!parts_->server) return;
    parts_->server->Shutdown(std::chrono::system_clock::now() + grace);
    parts_->server->Wait();
    parts_->server.reset();
}

}  // namespace kinevox
