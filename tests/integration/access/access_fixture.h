// A server with a guard on a free port, with or without TLS, before a fake capture; and calls by their path
// alone.
#pragma once

#include <gmock/gmock.h>
#include <grpcpp/generic/generic_stub.h>
#include <grpcpp/grpcpp.h>
#include <gtest/gtest.h>

#include <boost/asio/executor_work_guard.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/thread_pool.hpp>
#include <fstream>
#include <map>
#include <sstream>
#include <thread>

#include "server/access/audit_log.h"
#include "server/access/call_table.h"
#include "server/access/certificates.h"
#include "server/access/guard.h"
#include "server/access/token_file.h"
#include "server/api/api_server.h"
#include "tests/support/fake_capture.h"
#include "tests/support/patience.h"
#include "tests/support/person_volume.h"
#include "tests/support/small_session.h"

namespace kinevox {

namespace asio = boost::asio;

inline constexpr v1::Role kRoles[] = {v1::ROLE_VIEWER, v1::ROLE_DISPLAY, v1::ROLE_OPERATOR, v1::ROLE_ADMIN};

inline std::int64_t seconds_now() {
    return std::chrono::system_clock::to_time_t(std::chrono::system_clock::now());
}

// What `authorization` is sent with, once for each; the status that came back. `request`: the message's
// bytes.
inline grpc::Status call(const std::shared_ptr<grpc::Channel>& channel, const std::string& path,
                         const std::vector<std::string>& authorization, const std::string& request = "",
                         std::chrono::milliseconds limit = testing::patient(std::chrono::seconds(10))) {
    grpc::GenericStub stub(channel);
    grpc::CompletionQueue queue;
    grpc::ClientContext context;
    context.set_deadline(std::chrono::system_clock::now() + limit);
    for (const std::string& value : authorization) context.AddMetadata("authorization", value);
    auto caller = stub.PrepareCall(&context, path, &queue);
    void* tag = nullptr;
    bool ok = false;
    caller->StartCall(nullptr);
    queue.Next(&tag, &ok);
    const grpc::Slice slice(request);
    caller->WriteLast(grpc::ByteBuffer(&slice, 1), {}, nullptr);
    queue.Next(&tag, &ok);
    grpc::ByteBuffer answer;
    caller->Read(&answer, nullptr);
    queue.Next(&tag, &ok);
    grpc::Status status;
    caller->Finish(&status, nullptr);
    queue.Next(&tag, &ok);
    queue.Shutdown();
    while (queue.Next(&tag, &ok)) {
    }
    return status;
}

class AccessTest : public ::testing::Test {
  protected:
    ~AccessTest() override {
        runner_.abort();
        hub_.close(absl::UnavailableError("the daemon is stopping; connect again later"));
        server_.reset();
        control_.join();
        runner_.stop().IgnoreError();
        encoders_.join();
        io_.stop();
        io_thread_.join();
    }

    // With a token of each role; `options` as the test needs them.
    void serve(const AccessLimits& limits = {1000, 1000, 1e6}, const ApiServerOptions& options = {}) {
        for (const v1::Role role : kRoles) tokens_[role] = create(name_of(role), role);
        audit_ = *AuditLog::open(audit_file_);
        auto guard = Guard::create(token_file_, limits, audit_.get());
        ASSERT_TRUE(guard.ok()) << guard.status();
        guard_ = *std::move(guard);
        listen(options);
    }

    void serve_everybody(const AccessLimits& limits, const ApiServerOptions& options = {}) {
        guard_ = *Guard::create({}, limits);
        listen(options);
    }

    std::string create(const std::string& name, v1::Role role, int days = 1,
                       std::int64_t now_s = seconds_now()) {
        auto token = create_token(token_file_, {name, role, days}, now_s);
        EXPECT_TRUE(token.ok()) << token.status();
        return token.ok() ? "Bearer " + *token : "";
    }

    std::shared_ptr<grpc::Channel> plain() const {
        return grpc::CreateCustomChannel(address_, grpc::InsecureChannelCredentials(), own_connection());
    }

    // Not another channel's.
    static grpc::ChannelArguments own_connection() {
        grpc::ChannelArguments arguments;
        arguments.SetInt(GRPC_ARG_USE_LOCAL_SUBCHANNEL_POOL, 1);
        return arguments;
    }

    std::string audited() const {
        std::ifstream file(audit_file_);
        std::ostringstream text;
        text << file.rdbuf();
        return text.str();
    }

    testing::TemporaryFolder folder_;
    const std::filesystem::path token_file_ = folder_.path() / "tokens.toml",
                                audit_file_ = folder_.path() / "audit.jsonl";
    std::map<v1::Role, std::string> tokens_;
    std::unique_ptr<AuditLog> audit_;
    std::unique_ptr<Guard> guard_;
    std::string address_;

    testing::FakeSourceControl source_;
    StreamHub hub_;
    ControlLease lease_;
    Runner runner_{
        source_.open(), [this] { return source_.open(); },
        std::make_unique<testing::FakePipeline>(std::make_shared<const Volume>(testing::person_volume(0.02))),
        hub_};
    asio::io_context io_;
    asio::executor_work_guard<asio::io_context::executor_type> work_{io_.get_executor()};
    std::thread io_thread_{[this] { io_.run(); }};
    asio::thread_pool control_{1}, encoders_{2};
    ApiContext api_{.runner = runner_,
                    .hub = hub_,
                    .lease = lease_,
                    .threads = {.control = control_.get_executor(),
                                .encoders = encoders_.get_executor(),
                                .timers = io_.get_executor(),
                                .changes = control_.get_executor(),
                                .calibrating = control_.get_executor(),
                                .recordings = control_.get_executor(),
                                .exports = control_.get_executor()},
                    .source_description = "fake"};
    std::unique_ptr<ApiServer> server_;

  private:
    void listen(const ApiServerOptions& options) {
        api_.guard = guard_.get();
        auto server = ApiServer::listen("127.0.0.1:0", api_, options);
        ASSERT_TRUE(server.ok()) << server.status();
        server_ = *std::move(server);
        address_ = "127.0.0.1:" + std::to_string(server_->port());
    }
};

}  // namespace kinevox
