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

// Of one call.
class AuditInterceptor final : public grpc::experimental::Interceptor {
  public:
    AuditInterceptor(const Guard& guard, const CallTable::Call& call,
                     grpc::experimental::ServerRpcInfo* call_info)
        : guard_(guard), info_(call_info) {
        streams_ = call.method->server_streaming();
        entry_.method = call.method->service()->name() + "." + call.method->name();
    }

    // A call that its client left before its answer has no status to send.
    ~AuditInterceptor() override {
        if (!told_) tell("CANCELLED", "the client left");
    }

    void Intercept(grpc::experimental::InterceptorBatchMethods* methods) override {
        if (methods->QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_INITIAL_METADATA))
            who_calls();
        if (!streams_ && methods->QueryInterceptionHookPoint(InterceptionHookPoints::POST_RECV_MESSAGE))
            if (const void* request =
                    methods->GetRecvMessage())  // of a type that protoc made, which begins with its base
                entry_.request = essence(*static_cast<const google::protobuf::Message*>(request));
        if (methods->QueryInterceptionHookPoint(InterceptionHookPoints::PRE_SEND_STATUS)) {
            const grpc::Status status = methods->GetSendStatus();
            tell(absl::StatusCodeToString(static_cast<absl::StatusCode>(status.error_code())),
                 status.error_message());
        }
        methods->Proceed();
    }

  private:
    void who_calls() {
        const auto caller = guard_.identify(authorization_of(*info_->server_context()));
        entry_.who = caller.ok() ? caller->name : "";
        entry_.role = caller.ok() && !guard_.open() ? name_of(caller->role) : "";
        entry_.peer = info_->server_context()->peer();
    }

    void tell(std::string outcome, std::string message) {
        if (std::exchange(told_, true)) return;
        entry_.outcome = outcome.empty() ? "OK" : std::move(outcome);
        entry_.message = std::move(message);
        guard_.audit()->add(entry_);
    }

    const Guard& guard_;
    grpc::experimental::ServerRpcInfo* const info_;
    AuditEntry entry_;
    bool told_ = false;
    bool streams_ = false;  // some of those have their requests as bytes
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
