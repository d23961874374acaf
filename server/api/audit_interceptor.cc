#include "server/api/audit_interceptor.h"

#include <google/protobuf/descriptor.h>
#include <google/protobuf/message.h>
#include <grpcpp/server_context.h>
#include <grpcpp/support/server_interceptor.h>

#include <string>
#include <string_view>
#include <utility>

#include "server/access/audit_log.h"
#include "server/access/call_table.h"
#include "server/access/guard.h"
#include "server/api/caller.h"

namespace kinevox {
namespace {

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

std::unique_ptr<grpc::experimental::ServerInterceptorFactoryInterface> audit_interceptors(
    const Guard& guard) {
    return std::make_unique<AuditInterceptors>(guard);
}

}  // namespace kinevox
