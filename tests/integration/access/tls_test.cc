// Connections: certificates that are wrong, plain text against TLS, and those that say nothing.
#include <arpa/inet.h>
#include <grpc/support/log.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include "tests/integration/access/access_fixture.h"

namespace kinevox {
namespace {

using Kind = NewCertificate::Kind;
constexpr const char* kStatus = "/kinevox.v1.CaptureService/GetStatus";
constexpr std::int64_t kDay = 86'400;

CertificateAndKey make(Kind kind, const CertificateAndKey* authority, std::int64_t from_days = -1,
                       std::int64_t until_days = 1) {
    const auto hosts = kind == Kind::kServer ? std::vector<std::string>{"localhost", "127.0.0.1"}
                                             : std::vector<std::string>{};
    auto made = make_certificate(
        {kind, "test", hosts, seconds_now() + from_days * kDay, seconds_now() + until_days * kDay},
        authority);
    EXPECT_TRUE(made.ok()) << made.status();
    return *made;
}

class TlsTest : public AccessTest {
  protected:
    void serve_tls(bool clients_need_certificates) {
        const CertificateAndKey server = make(Kind::kServer, &ca_);
        ApiServerOptions options;
        options.identity =
            ServerIdentity{server.certificate, server.key, clients_need_certificates ? ca_.certificate : ""};
        options.handshake_timeout = std::chrono::seconds(2);
        serve({1000, 1000, 1e6}, options);
    }

    std::shared_ptr<grpc::Channel> tls(const CertificateAndKey& client, const std::string& ca) const {
        return grpc::CreateCustomChannel(
            address_,
            grpc::SslCredentials(
                {.pem_root_certs = ca, .pem_private_key = client.key, .pem_cert_chain = client.certificate}),
            own_connection());
    }

    grpc::Status ask(const std::shared_ptr<grpc::Channel>& channel, v1::Role role = v1::ROLE_ADMIN) {
        return call(channel, kStatus, {tokens_[role]});
    }

    void SetUp() override {
        gpr_set_log_function([](gpr_log_func_args*) {});  // gRPC logs each
    }

    const CertificateAndKey ca_ = make(Kind::kAuthority, nullptr),
                            foreign_ca_ = make(Kind::kAuthority, nullptr);
};

TEST_F(TlsTest, RequiresTokenOverTls) {
    serve_tls(false);
    const auto channel = tls({}, ca_.certificate);
    EXPECT_TRUE(ask(channel).ok()) << ask(channel).error_message();
    EXPECT_EQ(call(channel, kStatus, {}).error_code(), grpc::StatusCode::UNAUTHENTICATED);
    EXPECT_EQ(call(channel, kStatus, {"Bearer kvx_wrong"}).error_code(), grpc::StatusCode::UNAUTHENTICATED);
    EXPECT_EQ(
        call(channel, "/kinevox.v1.CaptureService/StartCapture", {tokens_[v1::ROLE_VIEWER]}).error_code(),
        grpc::StatusCode::PERMISSION_DENIED);
    EXPECT_EQ(ask(plain()).error_code(), grpc::StatusCode::UNAVAILABLE);
    EXPECT_EQ(ask(tls({}, foreign_ca_.certificate)).error_code(),
              grpc::StatusCode::UNAVAILABLE);  // the client refuses
}

TEST_F(TlsTest, RequiresClientCertificateAndToken) {
    serve_tls(true);
    const auto channel = tls(make(Kind::kClient, &ca_), ca_.certificate);
    EXPECT_TRUE(ask(channel).ok()) << ask(channel).error_message();
    EXPECT_EQ(call(channel, kStatus, {}).error_code(), grpc::StatusCode::UNAUTHENTICATED);
}

TEST_F(TlsTest, RejectsWrongCertificates) {
    serve_tls(true);
    const CertificateAndKey good = make(Kind::kClient, &ca_), foreign = make(Kind::kClient, &foreign_ca_);
    const std::vector<std::pair<const char*, CertificateAndKey>> wrong{
        {"none", {}},
        {"of another authority", foreign},
        {"signed by itself", make(Kind::kClient, nullptr)},
        {"an authority of its own", foreign_ca_},
        {"expired", make(Kind::kClient, &ca_, -3, -2)},
        {"not valid yet", make(Kind::kClient, &ca_, 2, 3)},
        {"for a server", make(Kind::kServer, &ca_)},
        {"with another's key", {good.certificate, foreign.key}},
    };
    for (int i = 0; i < 25; ++i)
        for (const auto& [what, client] : wrong) {
            const grpc::Status status = ask(tls(client, ca_.certificate));
            ASSERT_EQ(status.error_code(), grpc::StatusCode::UNAVAILABLE)
                << what << ": " << status.error_message();
        }
    EXPECT_EQ(ask(plain()).error_code(), grpc::StatusCode::UNAVAILABLE);
    EXPECT_TRUE(ask(tls(good, ca_.certificate)).ok());
}

// Connections that begin and say nothing.
class Idle {
  public:
    explicit Idle(const std::string& address) {
        const int port = std::stoi(address.substr(address.rfind(':') + 1));
        sockaddr_in to{.sin_family = AF_INET,
                       .sin_port = htons(static_cast<std::uint16_t>(port)),
                       .sin_addr = {htonl(INADDR_LOOPBACK)}};
        socket_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
        connected_ = ::connect(socket_, reinterpret_cast<const sockaddr*>(&to), sizeof to) == 0;
    }
    Idle(Idle&& other) noexcept : socket_(std::exchange(other.socket_, -1)), connected_(other.connected_) {}
    ~Idle() {
        if (socket_ >= 0) ::close(socket_);
    }
    bool connected() const { return connected_; }

    // Whether the server has hung up by then; what it says before that is read.
    bool is_closed_within(std::chrono::steady_clock::time_point end) {
        char data[4096];
        for (;;) {
            const auto left =
                std::chrono::duration_cast<std::chrono::milliseconds>(end - std::chrono::steady_clock::now());
            pollfd waiting{socket_, POLLIN, 0};
            if (left.count() <= 0 || ::poll(&waiting, 1, static_cast<int>(left.count())) <= 0) return false;
            if (::recv(socket_, data, sizeof data, 0) <= 0) return true;
        }
    }

  private:
    int socket_ = -1;
    bool connected_ = false;
};

TEST_F(TlsTest, ClosesIdleConnectionsWithoutDelayingOthers) {
    for (const bool encrypted : {true, false}) {
        if (encrypted) {
            serve_tls(false);
        } else {
            server_.reset();
            ApiServerOptions options;
            options.handshake_timeout = std::chrono::seconds(2);
            serve_everybody({}, options);
        }
        std::vector<Idle> idle;
        for (int i = 0; i < 200; ++i) {
            idle.emplace_back(address_);
            ASSERT_TRUE(idle.back().connected()) << i;
        }
        const auto before = std::chrono::steady_clock::now();
        const grpc::Status status = encrypted ? ask(tls({}, ca_.certificate)) : ask(plain());
        EXPECT_TRUE(status.ok()) << status.error_message();
        EXPECT_LT(std::chrono::steady_clock::now() - before, std::chrono::seconds(1));
        for (Idle& connection : idle)
            ASSERT_TRUE(connection.is_closed_within(before + std::chrono::seconds(20)));
    }
}

}  // namespace
}  // namespace kinevox
