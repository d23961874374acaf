// Limits, revoked tokens and the audit log.
#include <google/protobuf/descriptor.h>

#include <nlohmann/json.hpp>

#include "kinevox/v1/capture_service.grpc.pb.h"
#include "kinevox/v1/recording_service.grpc.pb.h"
#include "tests/integration/access/access_fixture.h"
#include "tests/support/patience.h"

namespace kinevox {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

// A stream of events.
class Watcher {
  public:
    Watcher(v1::CaptureService::Stub& stub, const std::string& authorization) {
        if (!authorization.empty()) context_.AddMetadata("authorization", authorization);
        context_.set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(50));
        reader_ = stub.WatchEvents(&context_, {});
    }
    ~Watcher() {
        context_.TryCancel();
        if (!ended_) wait_for_the_end();
    }
    // Until it is subscribed, or refused.
    void wait() { reader_->WaitForInitialMetadata(); }

    grpc::Status wait_for_the_end() {
        v1::WatchEventsResponse event;
        while (reader_->Read(&event)) {
        }
        ended_ = true;
        return reader_->Finish();
    }

  private:
    grpc::ClientContext context_;
    std::unique_ptr<grpc::ClientReader<v1::WatchEventsResponse>> reader_;
    bool ended_ = false;
};

class LimitsTest : public AccessTest {
  protected:
    using Watchers = std::vector<std::unique_ptr<Watcher>>;

    std::unique_ptr<v1::CaptureService::Stub> stub() const { return v1::CaptureService::NewStub(plain()); }

    Watchers open(v1::CaptureService::Stub& stub, int count, const std::string& authorization) {
        Watchers watchers;
        for (int i = 0; i < count; ++i) {
            watchers.push_back(std::make_unique<Watcher>(stub, authorization));
            watchers.back()->wait();
        }
        return watchers;
    }

    void wait_for_streams(int count) const {
        const auto end = std::chrono::steady_clock::now() + testing::patient(std::chrono::seconds(20));
        while (guard_->streams() != count && std::chrono::steady_clock::now() < end)
            std::this_thread::sleep_for(std::chrono::milliseconds(1));
        ASSERT_EQ(guard_->streams(), count);
    }

    // The audit log's lines of a method, when there are as many as that.
    std::vector<nlohmann::json> lines_of(const std::string& method, std::size_t count) const {
        std::vector<nlohmann::json> lines;
        const auto end = std::chrono::steady_clock::now() + testing::patient(std::chrono::seconds(10));
        do {
            lines.clear();
            std::istringstream text(audited());
            for (std::string line; std::getline(text, line);)
                if (auto read = nlohmann::json::parse(line, nullptr, false);
                    read.value("method", "") == method)
                    lines.push_back(std::move(read));
        } while (lines.size() < count && std::chrono::steady_clock::now() < end);
        return lines;
    }
};

TEST_F(LimitsTest, RefusesStreamsAboveMaximumUntilOneEnds) {
    serve_everybody({});  // as without a configuration
    const auto service = stub();
    Watchers watchers = open(*service, 1000, "");
    wait_for_streams(1000);
    const auto before = std::chrono::steady_clock::now();
    const grpc::Status refused = Watcher(*service, "").wait_for_the_end();
    EXPECT_LT(std::chrono::steady_clock::now() - before, testing::patient(std::chrono::milliseconds(500)));
    EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_THAT(refused.error_message(), AllOf(HasSubstr("1000"), HasSubstr("max_streams")));
    watchers.pop_back();
    wait_for_streams(999);
    Watcher next(*service, "");
    next.wait();
    wait_for_streams(1000);
}

TEST_F(LimitsTest, CountsStreamsPerToken) {
    serve({10, 3, 1e6});
    const auto service = stub();
    const std::string &watch = tokens_[v1::ROLE_VIEWER], &operates = tokens_[v1::ROLE_OPERATOR];
    const Watchers watchers = open(*service, 3, watch);
    const grpc::Status refused = Watcher(*service, watch).wait_for_the_end();
    EXPECT_EQ(refused.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED);
    EXPECT_THAT(refused.error_message(), HasSubstr("max_streams_per_token"));
    const Watchers others = open(*service, 3, operates);
    wait_for_streams(6);
}

TEST_F(LimitsTest, RefusesRequestsAboveRate) {
    serve({1000, 1000, 20});
    const auto channel = plain();
    int good = 0, refused = 0;
    std::string message;
    for (int i = 0; i < 200; ++i) {
        const grpc::Status status =
            call(channel, "/kinevox.v1.CaptureService/GetStatus", {tokens_[v1::ROLE_VIEWER]});
        good += status.ok();
        refused += status.error_code() == grpc::StatusCode::RESOURCE_EXHAUSTED;
        if (!status.ok()) message = status.error_message();
    }
    EXPECT_GE(good, 20);
    EXPECT_GT(refused, 0);
    EXPECT_EQ(good + refused, 200);
    EXPECT_THAT(message, HasSubstr("max_requests_per_s"));
    EXPECT_TRUE(call(channel, "/kinevox.v1.CaptureService/GetStatus", {tokens_[v1::ROLE_OPERATOR]})
                    .ok());  // not others
}

TEST_F(LimitsTest, RefusesLargeRequests) {
    ApiServerOptions options;
    options.max_request_bytes = 1 << 20;
    serve({1000, 1000, 1e6}, options);
    const grpc::Status status = call(plain(), "/kinevox.v1.CaptureService/StartCapture",
                                     {tokens_[v1::ROLE_OPERATOR]}, std::string((1 << 20) + 1, '\n'));
    EXPECT_EQ(status.error_code(), grpc::StatusCode::RESOURCE_EXHAUSTED) << status.error_message();
}

TEST_F(LimitsTest, EndsStreamsOfRevokedTokenOnly) {
    serve();
    const auto service = stub();
    Watcher revoked(*service, tokens_[v1::ROLE_VIEWER]), other(*service, tokens_[v1::ROLE_OPERATOR]);
    revoked.wait();
    other.wait();
    wait_for_streams(2);
    ASSERT_TRUE(revoke_token(token_file_, "viewer", seconds_now()).ok());
    guard_->tick();  // which the daemon does every second
    EXPECT_EQ(revoked.wait_for_the_end().error_code(), grpc::StatusCode::UNAUTHENTICATED);
    wait_for_streams(1);
    EXPECT_EQ(call(plain(), "/kinevox.v1.CaptureService/GetStatus", {tokens_[v1::ROLE_VIEWER]}).error_code(),
              grpc::StatusCode::UNAUTHENTICATED);
}

TEST_F(LimitsTest, EndsStreamsOfExpiredToken) {
    const std::string brief = create("brief", v1::ROLE_VIEWER, 1, seconds_now() - 86'400 + 3);
    serve();
    const auto service = stub();
    Watcher watcher(*service, brief);
    watcher.wait();
    wait_for_streams(1);
    guard_->tick();
    EXPECT_EQ(guard_->streams(), 1);
    const auto end = std::chrono::steady_clock::now() + testing::patient(std::chrono::seconds(10));
    while (guard_->streams() == 1 && std::chrono::steady_clock::now() < end) {
        guard_->tick();
        std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    EXPECT_EQ(watcher.wait_for_the_end().error_code(), grpc::StatusCode::UNAUTHENTICATED);
}

TEST_F(LimitsTest, RejectsAllTokensIfFileIsUnreadable) {
    serve();
    const auto channel = plain();
    const auto ask = [&] {
        return call(channel, "/kinevox.v1.CaptureService/GetStatus", {tokens_[v1::ROLE_VIEWER]}).error_code();
    };
    std::filesystem::permissions(token_file_, std::filesystem::perms::group_read,
                                 std::filesystem::perm_options::add);
    guard_->tick();
    EXPECT_EQ(ask(), grpc::StatusCode::UNAUTHENTICATED);
    std::filesystem::permissions(token_file_, std::filesystem::perms::group_read,
                                 std::filesystem::perm_options::remove);
    guard_->tick();
    EXPECT_EQ(ask(), grpc::StatusCode::OK);
    std::filesystem::remove(token_file_);
    guard_->tick();
    EXPECT_EQ(ask(), grpc::StatusCode::UNAUTHENTICATED);
}

TEST_F(LimitsTest, AuditsOperatingCallsWithoutSecrets) {
    serve();
    const auto channel = plain();
    v1::StartCaptureRequest start;
    start.set_lease_id("secret-lease");
    call(channel, "/kinevox.v1.CaptureService/StartCapture", {tokens_[v1::ROLE_OPERATOR]},
         start.SerializeAsString());
    v1::StartRecordingRequest record;
    record.set_lease_id("secret-lease");
    record.set_name("jump " + std::string(1000, 'x'));
    call(channel, "/kinevox.v1.RecordingService/StartRecording", {tokens_[v1::ROLE_ADMIN]},
         record.SerializeAsString());
    call(channel, "/kinevox.v1.CaptureService/StopCapture", {tokens_[v1::ROLE_DISPLAY]});
    call(channel, "/kinevox.v1.CaptureService/GetStatus", {tokens_[v1::ROLE_OPERATOR]});

    const auto started = lines_of("CaptureService.StartCapture", 1);
    ASSERT_EQ(started.size(), 1u);
    EXPECT_EQ(started[0].value("caller", ""), "operator");
    EXPECT_EQ(started[0].value("role", ""), "operator");
    EXPECT_EQ(started[0].value("outcome", ""), "FAILED_PRECONDITION");
    EXPECT_THAT(started[0].value("peer", ""), HasSubstr("127.0.0.1"));
    const auto recorded = lines_of("RecordingService.StartRecording", 1);
    ASSERT_EQ(recorded.size(), 1u);
    EXPECT_THAT(recorded[0].at("request").value("name", ""),
                AllOf(HasSubstr("jump xxx"), HasSubstr("1005 bytes")));
    const auto stopped = lines_of("CaptureService.StopCapture", 1);
    ASSERT_EQ(stopped.size(), 1u);
    EXPECT_EQ(stopped[0].value("outcome", ""), "PERMISSION_DENIED");
    EXPECT_EQ(stopped[0].value("caller", ""), "display");
    EXPECT_TRUE(lines_of("CaptureService.GetStatus", 0).empty());
    EXPECT_THAT(audited(), AllOf(Not(HasSubstr("secret-lease")), Not(HasSubstr("kvx_"))));
}

// By construction: whatever is added to the API later.
TEST_F(LimitsTest, AuditsEveryOperatingMethod) {
    serve();
    const auto channel = plain();
    std::size_t operating = 0;
    for (const auto& [path, what] : guard_->calls().calls()) {
        if (!what.method || !what.audited()) continue;
        ++operating;
        call(channel, path, {tokens_[v1::ROLE_ADMIN]});
    }
    for (const auto& [path, what] : guard_->calls().calls()) {
        if (!what.method || !what.audited()) continue;
        EXPECT_EQ(lines_of(what.method->service()->name() + "." + what.method->name(), 1).size(), 1u) << path;
    }
    EXPECT_GE(operating, 25u);
}

TEST_F(LimitsTest, CountsSuppressedRefusals) {
    serve();
    const auto channel = plain();
    for (int i = 0; i < 300; ++i) call(channel, "/kinevox.v1.CaptureService/StartCapture", {});
    server_.reset();
    guard_.reset();
    audit_.reset();  // writes the rest
    std::istringstream text(audited());
    std::uint64_t lines = 0, further = 0;
    for (std::string line; std::getline(text, line); ++lines)
        further += nlohmann::json::parse(line).value("suppressed_refusals", std::uint64_t{0});
    EXPECT_LT(lines, 100u);
    EXPECT_GT(further, 200u);
}

TEST_F(LimitsTest, ReopensMovedAuditFile) {
    serve();
    const auto channel = plain();
    call(channel, "/kinevox.v1.CaptureService/StartCapture", {tokens_[v1::ROLE_OPERATOR]});
    ASSERT_EQ(lines_of("CaptureService.StartCapture", 1).size(), 1u);
    std::filesystem::rename(audit_file_, folder_.path() / "audit.1");
    call(channel, "/kinevox.v1.CaptureService/StopCapture", {tokens_[v1::ROLE_OPERATOR]});
    EXPECT_EQ(lines_of("CaptureService.StopCapture", 1).size(), 1u);
    EXPECT_TRUE(lines_of("CaptureService.StartCapture", 0).empty());
}

}  // namespace
}  // namespace kinevox
