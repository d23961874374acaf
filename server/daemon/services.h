// What serves a capture: threads, access control, the gRPC server and the metrics endpoint.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <memory>
#include <optional>

#include "server/access/audit_log.h"
#include "server/access/guard.h"
#include "server/api/api_context.h"
#include "server/api/api_server.h"
#include "server/api/control_lease.h"
#include "server/api/subscribers.h"
#include "server/daemon/capture.h"
#include "server/metrics/http_endpoint.h"

namespace kinevox {

// Whether the configuration may serve: certificates, tokens and the audit log, before any camera is opened.
struct AccessSetup {
    ApiServerOptions server_options;
    std::unique_ptr<AuditLog> audit;
    std::unique_ptr<Guard> guard;

    static absl::StatusOr<AccessSetup> create(const ServerConfig& config, bool insecure);
};

// Members in the order in which they start. `capture` and `access` must outlive it.
struct Services {
    Services(boost::asio::io_context& io, Capture& capture, AccessSetup& access);
    absl::Status listen();

    Capture& capture;
    AccessSetup& access;
    ControlLease lease;
    FairShare fair_share;
    boost::asio::thread_pool control{1};      // start, stop and learning
    boost::asio::thread_pool changes{1};      // of the pose database
    boost::asio::thread_pool calibrating{1};  // files of calibrations
    boost::asio::thread_pool recordings{1};   // files of recordings
    boost::asio::thread_pool exports{1};
    std::optional<boost::asio::thread_pool> encoders;  // encode and write volumes and images
    std::optional<ApiContext> api;
    std::unique_ptr<ApiServer> server;
    std::unique_ptr<metrics::HttpEndpoint> endpoint;  // null without [metrics] listen

    // Shutdown in this order, between the steps of the capture's.
    void reject_calls();
    void end_calls();  // streams end with the status of Capture::notify_shutdown()
    void join_encoders() { encoders->join(); }
};

}  // namespace kinevox
