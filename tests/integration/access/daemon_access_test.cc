// kinevoxd, kinevox token and kinevox tls together, as an administrator uses them.
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <sys/stat.h>

#include <ctime>

#include "kinevox/v1/capture_service.grpc.pb.h"
#include "server/access/certificates.h"
#include "tests/integration/daemon/daemon_fixture.h"

namespace kinevox::testing {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr const char* kFlag = "--insecure";

std::string read(const std::filesystem::path& file) {
    std::ifstream stream(file);
    return {std::istreambuf_iterator<char>(stream), {}};
}

std::string first_line(const std::string& text) {
    return text.substr(0, text.find('\n'));
}

class AccessDaemonTest : public DaemonTest {
  protected:
    Ran token(std::vector<std::string> arguments) {
        arguments.insert(arguments.begin(), KINEVOX_TOKEN);
        arguments.insert(arguments.end(), {"--file", tokens_});
        return run(arguments, folder_.path());
    }

    Ran tls(std::vector<std::string> arguments) {
        arguments.insert(arguments.begin(), KINEVOX_TLS);
        arguments.insert(arguments.end(), {"--out", certificates_.string()});
        return run(arguments, folder_.path());
    }

    std::string create(const std::string& name, const std::string& role) {
        const Ran made = token({"create", name, "--role", role});
        EXPECT_EQ(made.status, 0) << made.errors;
        return first_line(made.output);
    }

    std::string config(const std::string& listen, const std::string& keys) const {
        return fmt::format(
            "[server]\nlisten = \"{}\"\naudit_file = \"audit.jsonl\"\n{}[pose]\ndatabase_file = "
            "\"\"\nauto_fit_body = "
            "false\n"
            "[calibration]\nfolder = \"\"\n[recording]\nfolder = \"\"\n[source]\nkind = \"session\"\n"
            "session_file = \"{}\"\n",
            listen, keys, session_.string());
    }

    std::string tls_keys() const {
        return fmt::format(
            "tls_certificate_file = \"{0}/server.pem\"\ntls_key_file = \"{0}/server-key.pem\"\n",
            certificates_.string());
    }

    // What it says where it does not start.
    Ran start_and_fail(const std::string& text) {
        const Ran ran =
            run({KINEVOX_DAEMON, "--config", write("kinevoxd.toml", text).string()}, folder_.path());
        EXPECT_EQ(ran.status, 1) << ran.output;
        EXPECT_EQ(std::ranges::count(ran.errors, '\n'), 1) << ran.errors;
        return ran;
    }

    std::unique_ptr<ChildProcess> start(const std::string& text, const std::vector<std::string>& flags = {}) {
        std::vector<std::string> command{KINEVOX_DAEMON, "--config", write("kinevoxd.toml", text).string()};
        command.insert(command.end(), flags.begin(), flags.end());
        auto daemon = std::make_unique<ChildProcess>(command, folder_.path());
        const std::string line = daemon->first_line();
        EXPECT_TRUE(line.starts_with("ready on ")) << line << daemon->errors();
        port_ = line.substr(line.rfind(':') + 1);
        return daemon;
    }

    std::unique_ptr<v1::CaptureService::Stub> stub() const {
        const auto credentials = grpc::SslCredentials({.pem_root_certs = read(certificates_ / "ca.pem")});
        return v1::CaptureService::NewStub(grpc::CreateChannel("localhost:" + port_, credentials));
    }

    static std::unique_ptr<grpc::ClientContext> context(const std::string& token) {
        auto made = std::make_unique<grpc::ClientContext>();
        made->set_deadline(std::chrono::system_clock::now() + std::chrono::seconds(20));
        if (!token.empty()) made->AddMetadata("authorization", "Bearer " + token);
        return made;
    }

    static grpc::StatusCode status(v1::CaptureService::Stub& stub, const std::string& token) {
        v1::GetStatusResponse response;
        return stub.GetStatus(context(token).get(), {}, &response).error_code();
    }

    const std::string tokens_ = (folder_.path() / "tokens.toml").string();
    const std::filesystem::path certificates_ = folder_.path() / "tls";
    std::string port_;
};

TEST_F(AccessDaemonTest, RequiresTlsAndTokensOnNetwork) {
    ASSERT_EQ(tls({"init"}).status, 0);
    create("anna", "admin");
    const std::string with_tokens = "token_file = \"" + tokens_ + "\"\n";
    EXPECT_THAT(start_and_fail(config("0.0.0.0:0", "")).errors,
                AllOf(HasSubstr("TLS and tokens"), HasSubstr("docs/access.md")));
    EXPECT_THAT(start_and_fail(config("0.0.0.0:0", tls_keys())).errors, HasSubstr("without tokens"));
    EXPECT_THAT(start_and_fail(config("0.0.0.0:0", with_tokens)).errors, HasSubstr("without TLS"));
    EXPECT_THAT(start_and_fail(config("[::]:0", "")).errors, HasSubstr("TLS and tokens"));
    EXPECT_THAT(start_and_fail(config("somewhere.example:0", "")).errors, HasSubstr("TLS and tokens"));
}

TEST_F(AccessDaemonTest, ServesEveryoneIfInsecure) {
    const auto daemon = start(config("0.0.0.0:0", ""), {kFlag});
    const auto open = v1::CaptureService::NewStub(
        grpc::CreateChannel("127.0.0.1:" + port_, grpc::InsecureChannelCredentials()));
    EXPECT_EQ(status(*open, ""), grpc::StatusCode::OK);
    daemon->signal(SIGTERM);
    EXPECT_EQ(daemon->wait(std::chrono::seconds(10)), 0);
    EXPECT_THAT(daemon->errors(), HasSubstr("everyone"));
}

TEST_F(AccessDaemonTest, ServesFromFirstCertificateToRevokedToken) {
    ASSERT_EQ(tls({"init", "--host", "hall.example"}).status, 0);
    const std::string anna = create("anna", "operator"), screen = create("hall-screen", "display");
    const auto daemon = start(config("0.0.0.0:0", tls_keys() + "token_file = \"" + tokens_ + "\"\n"));
    const auto service = stub();
    EXPECT_EQ(status(*service, anna), grpc::StatusCode::OK);
    EXPECT_EQ(status(*service, screen), grpc::StatusCode::OK);
    EXPECT_EQ(status(*service, ""), grpc::StatusCode::UNAUTHENTICATED);
    EXPECT_EQ(status(*service, anna + "x"), grpc::StatusCode::UNAUTHENTICATED);
    v1::AcquireControlRequest acquire;
    acquire.set_operator_name("anna");
    v1::AcquireControlResponse acquired;
    EXPECT_EQ(service->AcquireControl(context(screen).get(), acquire, &acquired).error_code(),
              grpc::StatusCode::PERMISSION_DENIED);
    EXPECT_TRUE(service->AcquireControl(context(anna).get(), acquire, &acquired).ok());

    const auto watching = context(anna);
    const auto events = service->WatchEvents(watching.get(), {});
    events->WaitForInitialMetadata();
    const auto revoked_at = std::chrono::steady_clock::now();
    ASSERT_EQ(token({"revoke", "anna"}).status, 0);
    v1::WatchEventsResponse event;
    while (events->Read(&event)) {
    }
    EXPECT_LT(std::chrono::steady_clock::now() - revoked_at,
              std::chrono::seconds(3));  // two, and the test's own process
    EXPECT_EQ(events->Finish().error_code(), grpc::StatusCode::UNAUTHENTICATED);
    EXPECT_EQ(status(*service, anna), grpc::StatusCode::UNAUTHENTICATED);
    EXPECT_EQ(status(*service, screen), grpc::StatusCode::OK);
    const std::string later = create("later", "viewer");
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(5);
    while (status(*service, later) != grpc::StatusCode::OK && std::chrono::steady_clock::now() < end)
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
    EXPECT_EQ(status(*service, later), grpc::StatusCode::OK);

    daemon->signal(SIGTERM);
    EXPECT_EQ(daemon->wait(std::chrono::seconds(10)), 0);
    EXPECT_THAT(read(folder_.path() / "audit.jsonl"),
                AllOf(HasSubstr(R"("caller":"anna","role":"operator")"),
                      HasSubstr(R"("method":"CaptureService.AcquireControl","outcome":"OK")"),
                      HasSubstr(R"("outcome":"PERMISSION_DENIED")")));
}

TEST_F(AccessDaemonTest, CreatesCertificatesOnceWithPrivateKeys) {
    ASSERT_EQ(tls({"init"}).status, 0);
    const std::string before = read(certificates_ / "server.pem");
    for (const char* key : {"ca-key.pem", "server-key.pem"}) {
        struct stat found {};
        ASSERT_EQ(::stat((certificates_ / key).c_str(), &found), 0) << key;
        EXPECT_EQ(found.st_mode & 0777, 0600u) << key;
    }
    const Ran again = tls({"init"});
    EXPECT_EQ(again.status, 1);
    EXPECT_THAT(again.errors, HasSubstr("not replaced"));
    EXPECT_EQ(tls({"issue", "server"}).status, 1);
    EXPECT_EQ(read(certificates_ / "server.pem"), before);
    EXPECT_EQ(tls({"issue", "client", "anna"}).status, 0);
    EXPECT_TRUE(
        check_certificate(read(certificates_ / "anna.pem"), read(certificates_ / "anna-key.pem")).ok());
    EXPECT_EQ(tls({"issue", "client", "anna"}).status, 1);
    EXPECT_EQ(tls({"issue", "client", "ca"}).status, 1);
    EXPECT_EQ(tls({"issue", "client", "../anna"}).status, 1);
}

// openssl's own verdict on what was made.
TEST_F(AccessDaemonTest, OpensslAcceptsTheChain) {
    ASSERT_EQ(tls({"init", "--host", "hall.example", "--host", "10.0.0.5"}).status, 0);
    ASSERT_EQ(tls({"issue", "client", "anna"}).status, 0);
    const std::string ca = (certificates_ / "ca.pem").string();
    for (const std::vector<std::string>& more :
         {std::vector<std::string>{"sslserver", "-verify_hostname", "hall.example", "server.pem"},
          {"sslserver", "-verify_ip", "10.0.0.5", "server.pem"},
          {"sslserver", "-verify_hostname", "localhost", "server.pem"},
          {"sslclient", "-verify_depth", "1", "anna.pem"}}) {
        const Ran verified = run({"/usr/bin/openssl", "verify", "-x509_strict", "-CAfile", ca, "-purpose",
                                  more[0], more[1], more[2], (certificates_ / more[3]).string()},
                                 folder_.path());
        EXPECT_EQ(verified.status, 0) << more[2] << ": " << verified.output << verified.errors;
    }
}

TEST_F(AccessDaemonTest, NamesUnusableCertificates) {
    ASSERT_EQ(tls({"init"}).status, 0);
    const std::string good = read(certificates_ / "server.pem");
    const auto keys = [&](const std::string& certificate, const std::string& key) {
        return fmt::format("tls_certificate_file = \"{}\"\ntls_key_file = \"{}\"\n", certificate, key);
    };
    const std::string own_key = (certificates_ / "server-key.pem").string(),
                      ca_key = (certificates_ / "ca-key.pem").string();
    EXPECT_THAT(
        start_and_fail(config("127.0.0.1:0", keys((certificates_ / "server.pem").string(), ca_key))).errors,
        HasSubstr("another certificate"));
    EXPECT_THAT(
        start_and_fail(config("127.0.0.1:0", keys(write("x.pem", "no certificate").string(), own_key)))
            .errors,
        HasSubstr("x.pem"));
    EXPECT_THAT(start_and_fail(config("127.0.0.1:0", "tls_certificate_file = \"tls/server.pem\"\n")).errors,
                HasSubstr("tls_certificate_file and tls_key_file"));
    const std::int64_t now_s = std::time(nullptr);
    const auto expired = make_certificate(
        {NewCertificate::Kind::kServer, "x", {"localhost"}, now_s - 9000, now_s - 100}, nullptr);
    ASSERT_TRUE(expired.ok());
    EXPECT_THAT(start_and_fail(config("127.0.0.1:0", keys(write("old.pem", expired->certificate).string(),
                                                          write("old-key.pem", expired->key).string())))
                    .errors,
                AllOf(HasSubstr("old.pem"), HasSubstr("expired")));
}

TEST_F(AccessDaemonTest, ShowsTokenOnce) {
    const std::string anna = create("anna", "operator");
    EXPECT_EQ(anna.substr(0, 4), "kvx_");
    EXPECT_EQ(token({"create", "anna", "--role", "operator"}).status, 1);
    EXPECT_EQ(token({"create", "bert", "--role", "king"}).status, 1);
    const Ran listed = token({"list"});
    EXPECT_EQ(listed.status, 0);
    EXPECT_THAT(listed.output, AllOf(HasSubstr("anna"), HasSubstr("operator"), HasSubstr("valid"),
                                     ::testing::Not(HasSubstr(anna))));
    EXPECT_EQ(token({"revoke", "anna"}).status, 0);
    EXPECT_THAT(token({"list"}).output, HasSubstr("revoked"));
    EXPECT_EQ(token({"revoke", "anna"}).status, 1);
}

}  // namespace
}  // namespace kinevox::testing
