// The gateway between a fake daemon and browsers of our own.
#include "client/web/gateway.h"

#include <gmock/gmock.h>

#include <fstream>
#include <thread>

#include "tests/integration/web/browser.h"
#include "tests/integration/web/fake_daemon.h"

namespace kinevox::web {
namespace {

using namespace std::chrono_literals;
using kinevox::testing::FakeDaemon;
using kinevox::testing::TestBrowser;
using ::testing::Each;
using ::testing::HasSubstr;
using Message = v1::GatewayMessage;
using boost::beast::websocket::close_code;
namespace fs = std::filesystem;
namespace asio = boost::asio;

class GatewayTest : public ::testing::Test {
  protected:
    GatewayTest() {
        fs::create_directories(folder_);
        std::ofstream(folder_ / "index.html") << "<html>";
        options_.listen = "127.0.0.1:0";
    }
    ~GatewayTest() override {
        stop();
        fs::remove_all(folder_);
    }

    void start() {
        if (!daemon_) daemon_ = std::make_unique<FakeDaemon>();
        options_.daemon.server = daemon_->address();
        gateway_ = *Gateway::open(options_, *Pages::read(folder_));
        thread_ = std::thread([this] { gateway_->run(); });
    }
    void stop() {
        if (!thread_.joinable()) return;
        gateway_->stop();
        thread_.join();
        gateway_.reset();
    }
    // What comes back to raw bytes, until the gateway closes.
    std::string raw(const std::string& bytes) {
        asio::io_context io;
        asio::ip::tcp::socket socket(io);
        const std::string address = gateway_->address();
        socket.connect({asio::ip::make_address("127.0.0.1"),
                        static_cast<std::uint16_t>(std::stoi(address.substr(address.rfind(':') + 1)))});
        boost::system::error_code e;
        asio::write(socket, asio::buffer(bytes), e);
        std::string answer;
        asio::read(socket, asio::dynamic_buffer(answer), e);
        return answer;
    }
    template <typename Condition>
    static bool eventually(const Condition& condition) {
        for (int n = 0; n < testing::patient(1000) && !condition(); ++n) std::this_thread::sleep_for(10ms);
        return condition();
    }

    const fs::path folder_ = fs::temp_directory_path() / ("kinevox-gateway-" + std::to_string(getpid()));
    GatewayOptions options_;
    std::unique_ptr<FakeDaemon> daemon_;
    std::unique_ptr<Gateway> gateway_;
    std::thread thread_;
};

TEST_F(GatewayTest, PassesPosesVolumesStatusAndSilhouettesOn) {
    start();
    TestBrowser browser(gateway_->address());
    ASSERT_FALSE(browser.error) << browser.error.message();
    const auto link = browser.wait_for(Message::kLink);
    ASSERT_TRUE(link);
    EXPECT_TRUE(link->link().connected()) << link->link().message();
    browser.ask({TestBrowser::want(v1::KIND_POSES), TestBrowser::want(v1::KIND_VOLUMES, "", 2),
                 TestBrowser::want(v1::KIND_STATUS), TestBrowser::want(v1::KIND_SILHOUETTE, "cam1")});
    const auto pose = browser.wait_for(Message::kPose);
    ASSERT_TRUE(pose);
    EXPECT_EQ(pose->pose().pose().angles(0).name(), "trunk_lean");
    const auto volume = browser.wait_for(Message::kVolume);
    ASSERT_TRUE(volume);
    EXPECT_EQ(volume->volume().volume(), FakeDaemon::volume_bytes());
    EXPECT_EQ(volume->level(), 2);
    EXPECT_DOUBLE_EQ(volume->volume().voxel_m(), 0.04);
    const auto silhouette = browser.wait_for(Message::kSilhouette);
    ASSERT_TRUE(silhouette);
    EXPECT_EQ(silhouette->silhouette().jpeg(), "a silhouette");
    const auto status = browser.wait_for(Message::kStatus);
    ASSERT_TRUE(status);
    EXPECT_EQ(status->status().version(), "fake");
    EXPECT_EQ(status->status().cameras(0).name(), "cam1");
    EXPECT_EQ(status->status().source(), "") << "names of files stay in the house";
    EXPECT_FALSE(status->status().has_control());
    EXPECT_FALSE(status->status().cameras(0).has_link());
}

TEST_F(GatewayTest, PicturesAreRefusedAndTheDaemonIsNeverAskedForOne) {
    start();
    TestBrowser browser(gateway_->address());
    browser.ask(
        {TestBrowser::want(v1::KIND_PICTURE, "cam1"), TestBrowser::want(v1::KIND_SILHOUETTE, "cam1")});
    const auto refused = browser.wait_for(Message::kRefusal);
    ASSERT_TRUE(refused);
    EXPECT_EQ(refused->refusal().code(), "PERMISSION_DENIED");
    EXPECT_EQ(refused->refusal().want().kind(), v1::KIND_PICTURE);
    ASSERT_TRUE(browser.wait_for(Message::kSilhouette)) << "the rest of the message holds";
    for (int kind = 5; kind < 40; ++kind) {
        browser.ask({TestBrowser::want(static_cast<v1::Kind>(kind), "cam1")});
        const auto again = browser.wait_for(Message::kRefusal);
        ASSERT_TRUE(again) << kind;
        EXPECT_EQ(again->refusal().want().kind(), kind);
        std::this_thread::sleep_for(40ms);  // below the limit on messages a second
    }
    EXPECT_THAT(daemon_->preview_kinds(), Each(kinevox::v1::StreamPreviewsRequest::KIND_SILHOUETTE));
    EXPECT_FALSE(daemon_->preview_kinds().empty());
}

TEST_F(GatewayTest, WhatTheDaemonRefusesIsToldOnce) {
    start();
    TestBrowser browser(gateway_->address());
    browser.ask({TestBrowser::want(v1::KIND_SILHOUETTE, "cam9"), TestBrowser::want(v1::KIND_POSES)});
    const auto refused = browser.wait_for(Message::kRefusal);
    ASSERT_TRUE(refused);
    EXPECT_EQ(refused->refusal().code(), "NOT_FOUND");
    EXPECT_EQ(refused->refusal().want().camera(), "cam9");
    EXPECT_THAT(refused->refusal().message(), HasSubstr("cam1"));
    EXPECT_TRUE(browser.wait_for(Message::kPose));
}

TEST_F(GatewayTest, BytesThatAreNoMessageAreRefusedAndThenTheSocketIsClosed) {
    start();
    TestBrowser browser(gateway_->address());
    for (int n = 0; n < 8; ++n) browser.send("\xff\xff\xff\xff nonsense");
    const auto refused = browser.wait_for(Message::kRefusal);
    ASSERT_TRUE(refused);
    EXPECT_EQ(refused->refusal().code(), "INVALID_ARGUMENT");
    EXPECT_FALSE(browser.wait_for(Message::kPose));
    EXPECT_EQ(browser.closed_with(), close_code::policy_error);

    TestBrowser large(gateway_->address()), text(gateway_->address()), flood(gateway_->address());
    large.send(std::string(5000, 'x'));
    EXPECT_FALSE(large.wait_for(Message::kPose));
    EXPECT_TRUE(large.error);
    text.send_text("poses, please");
    EXPECT_FALSE(text.wait_for(Message::kPose));
    EXPECT_EQ(text.closed_with(), close_code::unknown_data);
    for (int n = 0; n < 100; ++n) flood.ask({});
    EXPECT_FALSE(flood.wait_for(Message::kPose));
    EXPECT_EQ(flood.closed_with(), close_code::policy_error);
}

TEST_F(GatewayTest, ABrowserThatReadsSlowlyGetsTheNewestAndIsToldWhatItMissed) {
    daemon_ = std::make_unique<FakeDaemon>();
    daemon_->volume_padding = 400'000;
    daemon_->pause_ms = 1;
    options_.stuck = testing::patient(options_.stuck), options_.silence = testing::patient(options_.silence);
    start();
    TestBrowser slow(gateway_->address()), quick(gateway_->address());
    slow.ask({TestBrowser::want(v1::KIND_VOLUMES)});
    ASSERT_TRUE(slow.wait_for(Message::kVolume));
    quick.ask({TestBrowser::want(v1::KIND_VOLUMES)});
    std::uint64_t at = 0;
    const auto volume =
        quick.wait_for([&](const Message& m) { return (at = m.volume().header().sequence()) > 150; });
    ASSERT_TRUE(volume) << "one that does not read holds up no other";
    std::uint64_t last = 0, missed = 0, got = 0;
    while (last < at) {
        const auto next = slow.wait_for(Message::kVolume);
        ASSERT_TRUE(next);
        ++got;
        EXPECT_GT(next->volume().header().sequence(), last);
        missed += next->missed();
        last = next->volume().header().sequence();
    }
    EXPECT_GT(missed, 20u);
    EXPECT_LT(got, last - 20);
}

TEST_F(GatewayTest, ABrowserThatNeverReadsIsCutOff) {
    daemon_ = std::make_unique<FakeDaemon>();
    daemon_->volume_padding = 400'000;
    options_.stuck = 300ms;
    start();
    TestBrowser browser(gateway_->address());
    browser.ask({TestBrowser::want(v1::KIND_VOLUMES)});
    ASSERT_TRUE(browser.wait_for(Message::kVolume));
    EXPECT_TRUE(eventually([&] { return daemon_->streams == 0; })) << "its stream ends, too: nobody wants it";
}

TEST_F(GatewayTest, StreamsAreSharedAndEndWithTheLastWhoWantsThem) {
    start();
    auto first = std::make_unique<TestBrowser>(gateway_->address());
    TestBrowser second(gateway_->address());
    first->ask({TestBrowser::want(v1::KIND_POSES), TestBrowser::want(v1::KIND_VOLUMES)});
    second.ask({TestBrowser::want(v1::KIND_POSES)});
    ASSERT_TRUE(first->wait_for(Message::kVolume));
    ASSERT_TRUE(second.wait_for(Message::kPose));
    EXPECT_EQ(daemon_->streams, 2);
    first.reset();
    EXPECT_TRUE(eventually([&] { return daemon_->streams == 1; }));
    second.ask({});
    EXPECT_TRUE(eventually([&] { return daemon_->streams == 0; }));
}

TEST_F(GatewayTest, ComesBackWhenTheDaemonDoes) {
    start();
    TestBrowser browser(gateway_->address());
    browser.ask({TestBrowser::want(v1::KIND_POSES), TestBrowser::want(v1::KIND_VOLUMES, "", 1)});
    ASSERT_TRUE(browser.wait_for(Message::kPose));
    const int port = daemon_->port();
    daemon_.reset();
    const auto lost =
        browser.wait_for([](const Message& m) { return m.has_link() && !m.link().connected(); });
    ASSERT_TRUE(lost);
    EXPECT_THAT(lost->link().message(), HasSubstr("kinevoxd"));
    daemon_ = std::make_unique<FakeDaemon>(port);
    EXPECT_TRUE(browser.wait_for([](const Message& m) { return m.has_link() && m.link().connected(); }));
    EXPECT_TRUE(browser.wait_for(Message::kVolume));
    EXPECT_TRUE(browser.wait_for(Message::kPose));
}

TEST_F(GatewayTest, EndsWithAWordToTheBrowsers) {
    start();
    TestBrowser browser(gateway_->address());
    browser.ask({TestBrowser::want(v1::KIND_POSES)});
    ASSERT_TRUE(browser.wait_for(Message::kPose));
    std::thread reading([&] {
        while (browser.read()) {
        }
    });
    const auto begin = std::chrono::steady_clock::now();
    stop();
    EXPECT_LT(std::chrono::steady_clock::now() - begin, 3s);
    reading.join();
    EXPECT_EQ(browser.closed_with(), close_code::going_away);
}

TEST_F(GatewayTest, LimitsConnections) {
    options_.max_browsers = 2;
    start();
    TestBrowser first(gateway_->address()), second(gateway_->address()), third(gateway_->address());
    EXPECT_FALSE(third.wait_for(Message::kLink));
    EXPECT_EQ(third.closed_with(), close_code::try_again_later);
    EXPECT_TRUE(first.wait_for(Message::kLink) && second.wait_for(Message::kLink));
    EXPECT_TRUE(TestBrowser(gateway_->address(), "http://evil.example").error) << "a script of another page";
}

TEST_F(GatewayTest, AnswersHttpAndEndsWhatIsNone) {
    options_.request_timeout = 300ms;
    start();
    const std::string host = "Host: localhost\r\n";
    EXPECT_THAT(raw("GET / HTTP/1.1\r\n" + host + "Connection: close\r\n\r\n"), HasSubstr("<html>"));
    EXPECT_THAT(raw("HEAD / HTTP/1.1\r\n" + host + "Connection: close\r\n\r\n"),
                ::testing::Not(HasSubstr("<html>")));
    EXPECT_THAT(raw("GET / HTTP/1.1\r\n" + host + "X: " + std::string(20'000, 'x') + "\r\n\r\n"),
                HasSubstr("431"));
    EXPECT_THAT(raw("POST / HTTP/1.1\r\n" + host + "Content-Length: 1000000000\r\n\r\n"), HasSubstr("431"));
    EXPECT_EQ(raw("\x16\x03\x01 this is TLS\r\n\r\n"), "");
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_EQ(raw("GET / HT"), "") << "somebody who never ends his sentence";
    EXPECT_LT(std::chrono::steady_clock::now() - begin, 5s);
}

TEST_F(GatewayTest, AnAddressThatCannotBeHadIsNamed) {
    start();
    GatewayOptions other = options_;
    for (const char* bad : {"nowhere", "127.0.0.1", ":8090", "127.0.0.1:99999", "127.0.0.1:x"}) {
        other.listen = bad;
        EXPECT_TRUE(absl::IsInvalidArgument(Gateway::open(other, *Pages::read(folder_)).status())) << bad;
    }
    other.listen = "192.0.2.1:80";  // nobody's
    EXPECT_TRUE(absl::IsUnavailable(Gateway::open(other, *Pages::read(folder_)).status()));
}

}  // namespace
}  // namespace kinevox::web
