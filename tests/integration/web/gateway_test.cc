// The gateway between a fake daemon and test browsers.
#include "client/web/gateway.h"

#include <gmock/gmock.h>

#include <fstream>
#include <thread>

#include "tests/integration/web/browser.h"
#include "tests/integration/web/fake_daemon.h"
#include "tests/support/patience.h"
#include "tests/support/temporary_folder.h"

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
        std::ofstream(folder_ / "index.html") << "<html>";
        options_.listen = "127.0.0.1:0";
    }
    ~GatewayTest() override { stop(); }

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
    // Sends raw bytes; returns the reply until the gateway closes the connection.
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

    const testing::TemporaryFolder temporary_;
    const fs::path folder_ = temporary_.path();
    GatewayOptions options_;
    std::unique_ptr<FakeDaemon> daemon_;
    std::unique_ptr<Gateway> gateway_;
    std::thread thread_;
};

TEST_F(GatewayTest, ForwardsPosesVolumesStatusAndSilhouettes) {
    start();
    TestBrowser browser(gateway_->address());
    ASSERT_FALSE(browser.error) << browser.error.message();
    const auto connection = browser.wait_for(Message::kConnection);
    ASSERT_TRUE(connection);
    EXPECT_TRUE(connection->connection().connected()) << connection->connection().message();
    browser.subscribe({TestBrowser::subscription(v1::STREAM_KIND_POSES),
                       TestBrowser::subscription(v1::STREAM_KIND_VOLUMES, "", 2),
                       TestBrowser::subscription(v1::STREAM_KIND_STATUS),
                       TestBrowser::subscription(v1::STREAM_KIND_SILHOUETTE, "cam1")});
    const auto pose = browser.wait_for(Message::kPose);
    ASSERT_TRUE(pose);
    EXPECT_EQ(pose->pose().subjects(0).pose().angles(0).name(), "trunk_lean_geometric");
    const auto volume = browser.wait_for(Message::kVolume);
    ASSERT_TRUE(volume);
    EXPECT_EQ(volume->volume().subjects(0).encoded_volume(), FakeDaemon::volume_bytes());
    EXPECT_EQ(volume->downsample_level(), 2);
    EXPECT_DOUBLE_EQ(volume->volume().subjects(0).voxel_m(), 0.04);
    const auto silhouette = browser.wait_for(Message::kSilhouette);
    ASSERT_TRUE(silhouette);
    EXPECT_EQ(silhouette->silhouette().jpeg(), "a silhouette");
    const auto status = browser.wait_for(Message::kStatus);
    ASSERT_TRUE(status);
    EXPECT_EQ(status->status().version(), "fake");
    EXPECT_EQ(status->status().cameras(0).name(), "cam1");
    EXPECT_EQ(status->status().source(), "") << "file names stay private";
    EXPECT_FALSE(status->status().has_control_lease());
    EXPECT_FALSE(status->status().cameras(0).has_connection());
}

TEST_F(GatewayTest, SendsNamesOfSubjectsOnlyOnRequest) {
    for (const bool show_names : {false, true}) {
        options_.show_names = show_names;
        start();
        TestBrowser browser(gateway_->address());
        browser.subscribe({TestBrowser::subscription(v1::STREAM_KIND_POSES),
                           TestBrowser::subscription(v1::STREAM_KIND_VOLUMES),
                           TestBrowser::subscription(v1::STREAM_KIND_STATUS)});
        const auto pose = browser.wait_for(Message::kPose);
        const auto volume = browser.wait_for(Message::kVolume);
        const auto status = browser.wait_for(Message::kStatus);
        ASSERT_TRUE(pose && volume && status);
        const std::string expected = show_names ? "Anna" : "";
        EXPECT_EQ(pose->pose().subjects(0).name(), expected);
        EXPECT_EQ(volume->volume().subjects(0).subject().name(), expected);
        EXPECT_EQ(status->status().subjects(0).subject().name(), expected);
        stop();
    }
}

TEST_F(GatewayTest, NeverRequestsImages) {
    start();
    TestBrowser browser(gateway_->address());
    browser.subscribe({TestBrowser::subscription(v1::STREAM_KIND_IMAGE, "cam1"),
                       TestBrowser::subscription(v1::STREAM_KIND_SILHOUETTE, "cam1")});
    const auto rejected = browser.wait_for(Message::kError);
    ASSERT_TRUE(rejected);
    EXPECT_EQ(rejected->error().code(), "PERMISSION_DENIED");
    EXPECT_EQ(rejected->error().subscription().kind(), v1::STREAM_KIND_IMAGE);
    ASSERT_TRUE(browser.wait_for(Message::kSilhouette)) << "the other subscriptions start";
    for (int kind = 5; kind < 40; ++kind) {
        browser.subscribe({TestBrowser::subscription(static_cast<v1::StreamKind>(kind), "cam1")});
        const auto again = browser.wait_for(Message::kError);
        ASSERT_TRUE(again) << kind;
        EXPECT_EQ(again->error().subscription().kind(), kind);
        std::this_thread::sleep_for(40ms);  // below the limit on messages per second
    }
    EXPECT_THAT(daemon_->preview_kinds(), Each(kinevox::v1::StreamPreviewsRequest::KIND_SILHOUETTE));
    EXPECT_FALSE(daemon_->preview_kinds().empty());
}

TEST_F(GatewayTest, ReportsRejectionsOfTheDaemonOnce) {
    start();
    TestBrowser browser(gateway_->address());
    browser.subscribe({TestBrowser::subscription(v1::STREAM_KIND_SILHOUETTE, "cam9"),
                       TestBrowser::subscription(v1::STREAM_KIND_POSES)});
    const auto rejected = browser.wait_for(Message::kError);
    ASSERT_TRUE(rejected);
    EXPECT_EQ(rejected->error().code(), "NOT_FOUND");
    EXPECT_EQ(rejected->error().subscription().camera(), "cam9");
    EXPECT_THAT(rejected->error().message(), HasSubstr("cam1"));
    EXPECT_TRUE(browser.wait_for(Message::kPose));
}

TEST_F(GatewayTest, ClosesSocketAfterInvalidMessages) {
    start();
    TestBrowser browser(gateway_->address());
    for (int n = 0; n < 8; ++n) browser.send("\xff\xff\xff\xff nonsense");
    const auto rejected = browser.wait_for(Message::kError);
    ASSERT_TRUE(rejected);
    EXPECT_EQ(rejected->error().code(), "INVALID_ARGUMENT");
    EXPECT_FALSE(browser.wait_for(Message::kPose));
    EXPECT_EQ(browser.closed_with(), close_code::policy_error);

    TestBrowser large(gateway_->address()), text(gateway_->address()), flood(gateway_->address());
    large.send(std::string(5000, 'x'));
    EXPECT_FALSE(large.wait_for(Message::kPose));
    EXPECT_TRUE(large.error);
    text.send_text("poses");
    EXPECT_FALSE(text.wait_for(Message::kPose));
    EXPECT_EQ(text.closed_with(), close_code::unknown_data);
    for (int n = 0; n < 100; ++n) flood.subscribe({});
    EXPECT_FALSE(flood.wait_for(Message::kPose));
    EXPECT_EQ(flood.closed_with(), close_code::policy_error);
}

TEST_F(GatewayTest, SendsLatestAndMissedCountToSlowBrowser) {
    daemon_ = std::make_unique<FakeDaemon>();
    daemon_->volume_padding = 400'000;
    daemon_->pause_ms = 1;
    options_.write_timeout = testing::patient(options_.write_timeout),
    options_.idle_timeout = testing::patient(options_.idle_timeout);
    start();
    TestBrowser slow(gateway_->address()), quick(gateway_->address());
    slow.subscribe({TestBrowser::subscription(v1::STREAM_KIND_VOLUMES)});
    ASSERT_TRUE(slow.wait_for(Message::kVolume));
    quick.subscribe({TestBrowser::subscription(v1::STREAM_KIND_VOLUMES)});
    std::uint64_t at = 0;
    const auto volume =
        quick.wait_for([&](const Message& m) { return (at = m.volume().header().sequence()) > 150; });
    ASSERT_TRUE(volume) << "a slow browser delays no other";
    std::uint64_t last = 0, missed = 0, got = 0;
    while (last < at) {
        const auto next = slow.wait_for(Message::kVolume);
        ASSERT_TRUE(next);
        ++got;
        EXPECT_GT(next->volume().header().sequence(), last);
        missed += next->missed_count();
        last = next->volume().header().sequence();
    }
    EXPECT_GT(missed, 20u);
    EXPECT_LT(got, last - 20);
}

TEST_F(GatewayTest, DisconnectsBrowserThatDoesNotRead) {
    daemon_ = std::make_unique<FakeDaemon>();
    daemon_->volume_padding = 400'000;
    options_.write_timeout = 300ms;
    start();
    TestBrowser browser(gateway_->address());
    browser.subscribe({TestBrowser::subscription(v1::STREAM_KIND_VOLUMES)});
    ASSERT_TRUE(browser.wait_for(Message::kVolume));
    EXPECT_TRUE(testing::eventually([&] { return daemon_->streams == 0; }))
        << "its stream ends without subscribers";
}

TEST_F(GatewayTest, SharesStreamsUntilLastSubscriberLeaves) {
    start();
    auto first = std::make_unique<TestBrowser>(gateway_->address());
    TestBrowser second(gateway_->address());
    first->subscribe({TestBrowser::subscription(v1::STREAM_KIND_POSES),
                      TestBrowser::subscription(v1::STREAM_KIND_VOLUMES)});
    second.subscribe({TestBrowser::subscription(v1::STREAM_KIND_POSES)});
    ASSERT_TRUE(first->wait_for(Message::kVolume));
    ASSERT_TRUE(second.wait_for(Message::kPose));
    EXPECT_EQ(daemon_->streams, 2);
    first.reset();
    EXPECT_TRUE(testing::eventually([&] { return daemon_->streams == 1; }));
    second.subscribe({});
    EXPECT_TRUE(testing::eventually([&] { return daemon_->streams == 0; }));
}

TEST_F(GatewayTest, ReconnectsToRestartedDaemon) {
    start();
    TestBrowser browser(gateway_->address());
    browser.subscribe({TestBrowser::subscription(v1::STREAM_KIND_POSES),
                       TestBrowser::subscription(v1::STREAM_KIND_VOLUMES, "", 1)});
    ASSERT_TRUE(browser.wait_for(Message::kPose));
    const int port = daemon_->port();
    daemon_.reset();
    const auto lost =
        browser.wait_for([](const Message& m) { return m.has_connection() && !m.connection().connected(); });
    ASSERT_TRUE(lost);
    EXPECT_THAT(lost->connection().message(), HasSubstr("kinevoxd"));
    daemon_ = std::make_unique<FakeDaemon>(port);
    EXPECT_TRUE(
        browser.wait_for([](const Message& m) { return m.has_connection() && m.connection().connected(); }));
    EXPECT_TRUE(browser.wait_for(Message::kVolume));
    EXPECT_TRUE(browser.wait_for(Message::kPose));
}

TEST_F(GatewayTest, ClosesSocketsWithGoingAwayAtEnd) {
    start();
    TestBrowser browser(gateway_->address());
    browser.subscribe({TestBrowser::subscription(v1::STREAM_KIND_POSES)});
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
    options_.max_clients = 2;
    start();
    TestBrowser first(gateway_->address()), second(gateway_->address()), third(gateway_->address());
    EXPECT_FALSE(third.wait_for(Message::kConnection));
    EXPECT_EQ(third.closed_with(), close_code::try_again_later);
    EXPECT_TRUE(first.wait_for(Message::kConnection) && second.wait_for(Message::kConnection));
    EXPECT_TRUE(TestBrowser(gateway_->address(), "http://evil.example").error) << "foreign Origin";
}

TEST_F(GatewayTest, AnswersHttpAndClosesOtherConnections) {
    options_.request_timeout = 300ms;
    start();
    const std::string host = "Host: localhost\r\n";
    EXPECT_THAT(raw("GET / HTTP/1.1\r\n" + host + "Connection: close\r\n\r\n"), HasSubstr("<html>"));
    EXPECT_THAT(raw("HEAD / HTTP/1.1\r\n" + host + "Connection: close\r\n\r\n"),
                ::testing::Not(HasSubstr("<html>")));
    EXPECT_THAT(raw("GET / HTTP/1.1\r\n" + host + "X: " + std::string(20'000, 'x') + "\r\n\r\n"),
                HasSubstr("431"));
    EXPECT_THAT(raw("POST / HTTP/1.1\r\n" + host + "Content-Length: 1000000000\r\n\r\n"), HasSubstr("405"));
    EXPECT_EQ(raw("\x16\x03\x01 this is TLS\r\n\r\n"), "");
    const auto begin = std::chrono::steady_clock::now();
    EXPECT_EQ(raw("GET / HT"), "") << "an incomplete request";
    EXPECT_LT(std::chrono::steady_clock::now() - begin, 5s);
}

TEST_F(GatewayTest, RejectsDuplicateHostHeaders) {
    start();
    const std::string reply =
        raw("GET / HTTP/1.1\r\nHost: localhost\r\nHost: evil.example\r\n"
            "Connection: close\r\n\r\n");
    EXPECT_THAT(reply, HasSubstr("HTTP/1.1 400"));
    EXPECT_THAT(reply, ::testing::Not(HasSubstr("<html>")));
    EXPECT_THAT(raw("GET /ws HTTP/1.1\r\nHost: localhost\r\nHost: localhost\r\nConnection: Upgrade\r\n"
                    "Upgrade: websocket\r\nSec-WebSocket-Version: 13\r\n"
                    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n\r\n"),
                HasSubstr("HTTP/1.1 400"));
}

// A body is not read as the next request, and the reply arrives although the body was not read.
TEST_F(GatewayTest, ClosesConnectionAfterRequestWithBody) {
    start();
    const std::string host = "Host: localhost\r\n", smuggled = "GET / HTTP/1.1\r\n" + host + "\r\n";
    const std::string length = "Content-Length: " + std::to_string(smuggled.size()) + "\r\n\r\n";
    for (const std::string& post :
         {"POST / HTTP/1.1\r\n" + host + length + smuggled,
          "POST / HTTP/1.1\r\n" + host + "Content-Length: 400000\r\n\r\n" + std::string(400'000, 'x'),
          "POST / HTTP/1.1\r\n" + host + "Transfer-Encoding: chunked\r\n\r\n5\r\nhello\r\n0\r\n\r\n"}) {
        const std::string reply = raw(post);
        EXPECT_THAT(reply, HasSubstr("HTTP/1.1 405")) << post.substr(0, 100);
        EXPECT_THAT(reply, HasSubstr("Allow: GET, HEAD"));
        EXPECT_THAT(reply, HasSubstr("Connection: close"));
        EXPECT_THAT(reply, ::testing::Not(HasSubstr("<html>"))) << "the body was read as a request";
    }
    EXPECT_THAT(raw("GET / HTTP/1.1\r\n" + host + length + smuggled), HasSubstr("HTTP/1.1 400"));
}

TEST_F(GatewayTest, LimitsHalfOpenConnectionsPerAddress) {
    options_.max_half_open_per_address = 2;
    options_.request_timeout = testing::patient(30s);
    start();
    const std::string request = "GET / HTTP/1.1\r\nHost: localhost\r\n", end = "Connection: close\r\n\r\n";
    asio::io_context io;
    asio::ip::tcp::socket first(io), second(io);
    const auto connect = [&](asio::ip::tcp::socket& socket) {
        const std::string address = gateway_->address();
        socket.connect({asio::ip::make_address("127.0.0.1"),
                        static_cast<std::uint16_t>(std::stoi(address.substr(address.rfind(':') + 1)))});
        asio::write(socket, asio::buffer(request));
    };
    connect(first);
    connect(second);
    EXPECT_EQ(raw(request + end), "") << "a third connection without a request";
    asio::write(first, asio::buffer(end));
    std::string reply;
    boost::system::error_code e;
    asio::read(first, asio::dynamic_buffer(reply), e);
    EXPECT_THAT(reply, HasSubstr("HTTP/1.1 200"));
    EXPECT_THAT(raw(request + end), HasSubstr("HTTP/1.1 200"));
}

TEST_F(GatewayTest, NamesAddressItCannotListenOn) {
    start();
    GatewayOptions other = options_;
    for (const char* bad : {"nowhere", "127.0.0.1", ":8090", "127.0.0.1:99999", "127.0.0.1:x"}) {
        other.listen = bad;
        EXPECT_TRUE(absl::IsInvalidArgument(Gateway::open(other, *Pages::read(folder_)).status())) << bad;
    }
    other.listen = "192.0.2.1:80";  // not an address of this machine
    EXPECT_TRUE(absl::IsUnavailable(Gateway::open(other, *Pages::read(folder_)).status()));
}

}  // namespace
}  // namespace kinevox::web
