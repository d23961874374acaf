#include "server/api/call_access.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <grpc/grpc.h>
#include <grpc/grpc_security.h>
#include <grpcpp/security/server_credentials.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/server_interceptor.h>

#include <string>
#include <string_view>
#include <utility>

#include "server/access/audit_log.h"
#include "server/access/call_table.h"
#include "server/access/guard.h"
#include "server/api/call.h"

namespace kinevox {
namespace {

std::string_view view(const grpc_slice& slice) {
    return {reinterpret_cast<const char*>(GRPC_SLICE_START_PTR(slice)), GRPC_SLICE_LENGTH(slice)};
}

// Called by gRPC between a call's headers and its service. Several authorizations are invalid, because guard
// and service could read different ones.
void admit(void* guard, grpc_auth_context*, const grpc_metadata* metadata, std::size_t count,
           grpc_process_auth_metadata_done_cb done, void* call) {
    std::string_view path, authorization;
    for (std::size_t i = 0; i < count; ++i) {
        const std::string_view key = view(metadata[i].key), value = view(metadata[i].value);
        if (key == ":path") path = value;
        if (key == "authorization") authorization = authorization.empty() ? value : "twice";
    }
    const absl::Status status = static_cast<Guard*>(guard)->admit(path, authorization);
    done(call, nullptr, 0, nullptr, 0, static_cast<grpc_status_code>(status.code()),
         status.ok() ? nullptr : std::string(status.message()).c_str());
}

// gRPC's unencrypted C++ credentials accept no metadata processor; its C API supports it for both kinds.
class GuardedCredentials final : public grpc::ServerCredentials {
  public:
    GuardedCredentials(std::optional<ServerIdentity> identity, Guard* guard)
        : identity_(std::move(identity)), guard_(guard) {}
    void SetAuthMetadataProcessor(const std::shared_ptr<grpc::AuthMetadataProcessor>&) override {}

  private:
    int AddPortToServer(const std::string& address, grpc_server* server) override {
        grpc_server_credentials* const credentials = make();
        if (guard_)
            grpc_server_credentials_set_auth_metadata_processor(credentials, {admit, nullptr, guard_});
        const int port = grpc_server_add_http2_port(server, address.c_str(), credentials);
        grpc_server_credentials_release(credentials);
        return port;
    }

    grpc_server_credentials* make() const {
        if (!identity_) return grpc_insecure_server_credentials_create();
        grpc_ssl_pem_key_cert_pair pair{identity_->key.c_str(), identity_->certificate.c_str()};
        const bool ask = !identity_->client_ca.empty();
        return grpc_ssl_server_credentials_create_ex(
            ask ? identity_->client_ca.c_str() : nullptr, &pair, 1,
            ask ? GRPC_SSL_REQUEST_AND_REQUIRE_CLIENT_CERTIFICATE_AND_VERIFY
                : GRPC_SSL_DONT_REQUEST_CLIENT_CERTIFICATE,
            nullptr);
    }

    const std::optional<ServerIdentity> identity_;
    Guard* const guard_;
};

using grpc::experimental::InterceptionHookPoints;

// Audits one call.
class AuditInterceptor final : public grpc::experimental::Interceptor {
  public:
    AuditInterceptor(const Guard& guard, const CallTable::Call& call,
                     grpc::experimental::ServerRpcInfo* call_info)
        : guard_(guard), info_(call_info) {
        streams_ = call.method->server_streaming();
        entry_.method = call.method->service()->name() + "." + call.method->name();
    }

    // A call cancelled by its client sends no status.
    ~AuditInterceptor() override {
        if (!logged_) log("CANCELLED", "the client left");
    }

    void Intercept(grpc::experimental::InterceptorBatchMethods* methods) override {
        if (methods->QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_INITIAL_METADATA))
            identify_caller();
        if (!streams_ && methods->QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_MESSAGE))
            if (const void* request =
                    methods->GetRecvMessage())  // generated messages begin with their base class
                entry_.request = request_summary(*static_cast<const google::protobuf::Message*>(request));
        if (methods->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_STATUS)) {
            const grpc::Status status = methods->GetSendStatus();
            log(absl::StatusCodeToString(static_cast<absl::StatusCode>(status.error_code())),
                status.error_message());
        }
        methods->Proceed();
    }

  private:
    void identify_caller() {
        const auto caller = guard_.identify(authorization_of(*info_->server_context()));
        entry_.caller = caller.ok() ? caller->name : "";
        entry_.role = caller.ok() && !guard_.open() ? name_of(caller->role) : "";
        entry_.peer = info_->server_context()->peer();
    }

    void log(std::string outcome, std::string message) {
        if (std::exchange(logged_, true)) return;
        entry_.outcome = outcome.empty() ? "OK" : std::move(outcome);
        entry_.message = std::move(message);
        guard_.audit()->add(entry_);
    }

    const Guard& guard_;
    grpc::experimental::ServerRpcInfo* const info_;
    AuditEntry entry_;
    bool logged_ = false;
    bool streams_ = false;  // some streams have raw requests
};

class AuditInterceptors final : public grpc::experimental::ServerInterceptorFactoryInterface {
  public:
    explicit AuditInterceptors(const Guard& guard) : guard_(guard) {}

    grpc::experimental::Interceptor* CreateServerInterceptor(
        grpc::experimental::ServerRpcInfo* info) override {
        const CallTable::Call* call = guard_.calls().find(info->method());
        return call && call->method && call->audited() ? new AuditInterceptor(guard_, *call, info) : nullptr;
    }

  private:
    const Guard& guard_;
};

}  // namespace

std::shared_ptr<grpc::ServerCredentials> guarded_credentials(const std::optional<ServerIdentity>& identity,
                                                             Guard* guard) {
    return std::make_shared<GuardedCredentials>(identity, guard);
}

std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> audit_interceptors(
    const Guard& guard) {
    return std::make_unique<AuditInterceptors>(guard);
}

}  // namespace kinevox
