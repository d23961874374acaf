// What is read from the files that a user names for a connection, and what is refused.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

#include "client/lib/client.h"

namespace kinevox::client {
namespace {

using ::testing::HasSubstr;

constexpr const char* kCertificate = "-----BEGIN CERTIFICATE-----\nMIIB\n-----END CERTIFICATE-----\n";
constexpr const char* kKey = "-----BEGIN PRIVATE KEY-----\nMIIB\n-----END PRIVATE KEY-----\n";

class SecurityTest : public ::testing::Test {
  protected:
    void SetUp() override {
        folder_ = std::filesystem::path(::testing::TempDir()) /
                  ::testing::UnitTest::GetInstance()->current_test_info()->name();
        std::filesystem::create_directories(folder_);
    }
    void TearDown() override { std::filesystem::remove_all(folder_); }

    std::string file(const std::string& name, const std::string& text) {
        const auto path = folder_ / name;
        std::ofstream(path, std::ios::binary) << text;
        return path.string();
    }

    std::filesystem::path folder_;
};

TEST_F(SecurityTest, IsPlainWithoutFiles) {
    const auto security = read_security({}, "hall:50770");
    ASSERT_TRUE(security.ok()) << security.status();
    EXPECT_FALSE(security->tls);
    EXPECT_EQ(security->token, "");
}

TEST_F(SecurityTest, EachFileImpliesTls) {
    const std::string ca = file("ca.pem", kCertificate), key = file("key.pem", kKey);
    const auto with_ca = read_security({.ca = ca}, "hall:50770");
    ASSERT_TRUE(with_ca.ok()) << with_ca.status();
    EXPECT_TRUE(with_ca->tls);
    EXPECT_EQ(with_ca->ca_pem, kCertificate);
    const auto mutual = read_security({.certificate = ca, .key = key}, "hall:50770");
    ASSERT_TRUE(mutual.ok()) << mutual.status();
    EXPECT_TRUE(mutual->tls);
    EXPECT_EQ(mutual->key_pem, kKey);
    EXPECT_TRUE(read_security({.server_name = "kinevox"}, "10.0.0.7:50770")->tls);
}

TEST_F(SecurityTest, TokenIsFirstWordOfFile) {
    const auto security =
        read_security({.token = file("token", "\n  kvx_abc123\nsomething else\n")}, "127.0.0.1:50770");
    ASSERT_TRUE(security.ok()) << security.status();
    EXPECT_EQ(security->token, "kvx_abc123");
    EXPECT_FALSE(security->tls);  // on this machine it is not sent over a network
}

TEST_F(SecurityTest, TokenIsNotSentUnencrypted) {
    const std::string token = file("token", "kvx_abc123");
    for (const char* server : {"hall:50770", "10.0.0.7:50770", "127.evil.example:1", "localhost.example:1"}) {
        const auto plain = read_security({.token = token}, server);
        ASSERT_FALSE(plain.ok()) << server;
        EXPECT_THAT(std::string(plain.status().message()), HasSubstr("--tls"));
    }
    EXPECT_TRUE(read_security({.tls = true, .token = token}, "hall:50770").ok());
}

TEST_F(SecurityTest, ErrorsNameFile) {
    const std::string good = file("good.pem", kCertificate), key = file("key.pem", kKey);
    const std::string gone = (folder_ / "gone.pem").string();
    const struct {
        SecurityFiles files;
        std::string says;
    } cases[] = {
        {{.ca = gone}, gone},
        {{.ca = folder_.string()}, "cannot be read"},
        {{.ca = file("text.pem", "hello")}, "no CERTIFICATE"},
        {{.certificate = good}, "--key"},
        {{.key = key}, "--certificate"},
        {{.certificate = good, .key = good}, "no PRIVATE KEY"},
        {{.token = file("empty", " \n")}, "empty"},
        {{.token = file("binary", std::string("kvx\x01\xff", 5))}, "does not contain a token"},
        {{.token = file("large", std::string(2 << 20, 'x'))}, "larger than"},
    };
    for (const auto& each : cases) {
        const auto security = read_security(each.files, "127.0.0.1:1");
        ASSERT_FALSE(security.ok()) << each.says;
        EXPECT_THAT(std::string(security.status().message()), HasSubstr(each.says));
    }
}

}  // namespace
}  // namespace kinevox::client
