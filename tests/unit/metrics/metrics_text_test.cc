// Metrics as text: both formats, escapes, histograms; and the HTTP server that gives them out.
#include "server/metrics/metrics_text.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <boost/asio/connect.hpp>
#include <boost/asio/io_context.hpp>
#include <boost/asio/ip/tcp.hpp>
#include <boost/asio/read.hpp>
#include <boost/asio/write.hpp>
#include <limits>
#include <thread>

#include "server/metrics/capture_metrics.h"
#include "server/metrics/http_endpoint.h"
#include "server/pipeline/capture_statistics.h"

namespace kinevox::metrics {
namespace {

using testing::HasSubstr;
using testing::Not;
using testing::StartsWith;
using namespace std::string_literals;

TEST(MetricsText, NamesCountersByFormat) {
    MetricsText open(Format::kOpenMetrics), old(Format::kPrometheus);
    open.one_counter("kinevox_frame_sets_processed", "Results.", 12);
    old.one_counter("kinevox_frame_sets_processed", "Results.", 12);
    EXPECT_EQ(open.take(),
              "# HELP kinevox_frame_sets_processed Results.\n# TYPE kinevox_frame_sets_processed "
              "counter\nkinevox_frame_sets_processed_total 12\n# EOF\n");
    EXPECT_EQ(old.take(),
              "# HELP kinevox_frame_sets_processed_total Results.\n# TYPE kinevox_frame_sets_processed_total "
              "counter\nkinevox_frame_sets_processed_total 12\n");
}

TEST(CaptureMetrics, NameDeviceThatComputes) {
    MetricsSnapshot snapshot;
    EXPECT_THAT(capture_metrics(snapshot, Format::kPrometheus),
                HasSubstr("\nkinevox_compute_device{device=\"cpu\"} 1\n# HELP kinevox_gpu_configured"));
    snapshot.gpu_configured = true;
    snapshot.gpu = {.device = "cuda:1", .name = "NVIDIA T4", .usable = true};
    EXPECT_THAT(capture_metrics(snapshot, Format::kPrometheus),
                HasSubstr("\nkinevox_compute_device{device=\"cpu\"} 0\n"
                          "kinevox_compute_device{device=\"cuda:1\",gpu=\"NVIDIA T4\"} 1\n"));
    snapshot.gpu.usable = false;
    EXPECT_THAT(capture_metrics(snapshot, Format::kPrometheus),
                HasSubstr("\nkinevox_compute_device{device=\"cpu\"} 1\n"
                          "kinevox_compute_device{device=\"cuda:1\",gpu=\"NVIDIA T4\"} 0\n"));
}

TEST(MetricsText, EscapesLabelsAndHelp) {
    MetricsText text(Format::kOpenMetrics);
    text.gauge("kinevox_capture_state", "One\nline with \\.");
    text.sample(1, {{"camera", "a\"b\\c\nd"}, {"other", "x"}});
    EXPECT_THAT(
        text.take(),
        HasSubstr("# HELP kinevox_capture_state One\\nline with \\\\.\n# TYPE kinevox_capture_state gauge\n"
                  "kinevox_capture_state{camera=\"a\\\"b\\\\c\\nd\",other=\"x\"} 1\n"));
}

TEST(MetricsText, WritesExactNumbers) {
    MetricsText text(Format::kPrometheus);
    text.gauge("g", "h");
    for (const double value : {0.1, 1e20, -3.0, 1.0 / 3, std::numeric_limits<double>::quiet_NaN(),
                               std::numeric_limits<double>::infinity()})
        text.sample(value);
    EXPECT_THAT(text.take(), HasSubstr("g 0.1\ng 1e+20\ng -3\ng 0.3333333333333333\ng NaN\ng +Inf\n"));
}

TEST(RunningHistogram, CountsCumulativeBuckets) {
    RunningHistogram running;
    for (const double seconds : {0.0001, 0.0005, 0.004, 0.004, 7.0}) running.add(seconds);
    const Histogram read = running.read();
    ASSERT_EQ(read.counts.size(), read.bounds.size() + 1);
    EXPECT_EQ(read.counts[0], 2u);  // a bound belongs to its bucket
    EXPECT_EQ(read.counts.back(), 1u);
    EXPECT_NEAR(read.sum, 7.0086, 1e-6);
    MetricsText text(Format::kOpenMetrics);
    text.histogram("t", "h");
    text.sample(read, {{"stage", "hull"}});
    const std::string out = text.take();
    EXPECT_THAT(out, HasSubstr("t_bucket{stage=\"hull\",le=\"0.0005\"} 2\n"));
    EXPECT_THAT(out, HasSubstr("t_bucket{stage=\"hull\",le=\"0.005\"} 4\n"));
    EXPECT_THAT(out, HasSubstr("t_bucket{stage=\"hull\",le=\"+Inf\"} 5\nt_sum{stage=\"hull\"} "
                               "7.0086\nt_count{stage=\"hull\"} 5\n"));
}

// What the server answers to these bytes, until it closes.
std::string ask(int port, const std::string& request) {
    boost::asio::io_context io;
    boost::asio::ip::tcp::socket socket(io);
    socket.connect({boost::asio::ip::make_address("127.0.0.1"), static_cast<unsigned short>(port)});
    std::string answer;
    boost::system::error_code error;  // it may close before it has read all
    boost::asio::write(socket, boost::asio::buffer(request), error);
    boost::asio::read(socket, boost::asio::dynamic_buffer(answer), error);
    return answer;
}

class HttpEndpointTest : public testing::Test {
  protected:
    HttpEndpointTest() {
        auto endpoint = HttpEndpoint::listen("127.0.0.1:0", [](Format format) {
            MetricsText text(format);
            text.one_counter("c", "h", 1);
            return text.take();
        });
        EXPECT_TRUE(endpoint.ok()) << endpoint.status();
        endpoint_ = *std::move(endpoint);
    }
    std::string get(const std::string& path, const std::string& headers = "",
                    const std::string& method = "GET") {
        return ask(endpoint_->port(),
                   method + " " + path + " HTTP/1.1\r\nHost: x\r\nConnection: close\r\n" + headers + "\r\n");
    }
    std::unique_ptr<HttpEndpoint> endpoint_;
};

TEST_F(HttpEndpointTest, AnswersInRequestedFormat) {
    const std::string old = get("/metrics");
    EXPECT_THAT(old, StartsWith("HTTP/1.1 200 OK"));
    EXPECT_THAT(old, HasSubstr("text/plain; version=0.0.4"));
    EXPECT_THAT(old, Not(HasSubstr("# EOF")));
    const std::string open =
        get("/metrics", "Accept: application/openmetrics-text;version=1.0.0;q=0.75,text/plain;q=0.5\r\n");
    EXPECT_THAT(open, HasSubstr("application/openmetrics-text; version=1.0.0"));
    EXPECT_THAT(open, HasSubstr("# EOF"));
    EXPECT_THAT(get("/metrics?x=1"), StartsWith("HTTP/1.1 200 OK"));
}

TEST_F(HttpEndpointTest, RejectsOtherPaths) {
    EXPECT_THAT(get("/"), StartsWith("HTTP/1.1 404"));
    EXPECT_THAT(get("/../etc/passwd"), StartsWith("HTTP/1.1 404"));
    EXPECT_THAT(get("/metrics", "", "DELETE"), StartsWith("HTTP/1.1 405"));
    EXPECT_THAT(get("/metrics", "", "HEAD"), Not(HasSubstr("# TYPE")));
}

TEST_F(HttpEndpointTest, SurvivesInvalidAndIdleClients) {
    using boost::asio::ip::tcp;
    boost::asio::io_context io;
    std::vector<tcp::socket> silent;
    for (int i = 0; i < 10; ++i) {
        silent.emplace_back(io);
        silent.back().connect(
            {boost::asio::ip::make_address("127.0.0.1"), static_cast<unsigned short>(endpoint_->port())});
    }
    ask(endpoint_->port(), "\x16\x03\x01\x02\x00\x01\x00\x01 nothing of HTTP\r\n\r\n"s);
    ask(endpoint_->port(), "GET /metrics HTTP/1.1\r\nX: " + std::string(100'000, 'x') + "\r\n\r\n");
    EXPECT_THAT(get("/metrics"), StartsWith("HTTP/1.1 200 OK"));
}

TEST_F(HttpEndpointTest, ReportsPortInUse) {
    const auto second =
        HttpEndpoint::listen("127.0.0.1:" + std::to_string(endpoint_->port()), [](Format) { return ""; });
    ASSERT_FALSE(second.ok());
    EXPECT_THAT(std::string(second.status().message()), HasSubstr("[metrics]"));
}

}  // namespace
}  // namespace kinevox::metrics
