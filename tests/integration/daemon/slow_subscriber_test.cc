// A client that reads nothing must neither slow the pipeline nor fill the daemon's memory.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <grpcpp/grpcpp.h>
#include <signal.h>

#include <algorithm>
#include <optional>
#include <thread>

#include "common/stopwatch.h"
#include "kinevox/v1/stream_service.grpc.pb.h"
#include "tests/integration/daemon/daemon_fixture.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;

class SlowSubscriberTest : public testing::DaemonTest {
  protected:
    struct Phase {
        double results_per_second = 0;
        double cpu_ms_per_result = 0;  // says more than the rate where other programs want the processor, too
        double max_resident_mb = 0;
    };

    // What the daemon does in `seconds`. Here time is the quantity under test, so here is a sleep.
    static Phase observe(client::Client& client, const testing::ChildProcess& daemon, double seconds) {
        Phase phase;
        const Stopwatch observed;
        const auto first = client.status();
        const double cpu_before_ms = daemon.cpu_ms();
        while (observed.seconds() < seconds) {
            std::this_thread::sleep_for(std::chrono::milliseconds(100));
            phase.max_resident_mb = std::max(phase.max_resident_mb, daemon.resident_mb());
        }
        const double took = observed.seconds();
        const double results = static_cast<double>(client.status()->result_count() - first->result_count());
        phase.results_per_second = results / took;
        phase.cpu_ms_per_result = (daemon.cpu_ms() - cpu_before_ms) / std::max(results, 1.0);
        return phase;
    }
};

// A subscription without a reader.
struct Stalled {
    Stalled(v1::StreamService::Stub& stub, const v1::StreamVolumesRequest& request)
        : reader(stub.StreamVolumes(&context, request)) {
        reader->WaitForInitialMetadata();
    }
    ~Stalled() {
        context.TryCancel();
        reader->Finish();  // the status is of no interest
    }
    grpc::ClientContext context;
    std::unique_ptr<grpc::ClientReader<v1::StreamVolumesResponse>> reader;
};

TEST_F(SlowSubscriberTest, HasNoEffectOnRateAndMemory) {
    // The source's pace decides the rate: ten a second, of which this takes a fraction of a core. A pipeline
    // that waits for a subscriber falls behind that pace at once and in every round; other programs do in
    // some, so the best of up to four rounds counts.
    constexpr double kStalledSeconds = 10;
    constexpr int kMaxRounds = 4;
    const auto session = testing::write_small_session(folder_.path() / "session", {.fps = 10});
    const auto daemon = start_daemon(fmt::format(
        "[server]\nlisten = \"127.0.0.1:0\"\n[source]\nkind = \"session\"\nsession_file = \"{}\"\n"
        "[pose]\ndatabase_file = \"\"\nauto_fit_body = false\n",  // both take time and memory of their own
        session.string()));
    client::Client client({.server = address_});
    wait_for_a_volume(client);
    observe(client, *daemon, 3);  // memory pools fill

    // Buffers of the client's transport would hide that nothing is read.
    grpc::ChannelArguments arguments;
    arguments.SetInt(GRPC_ARG_HTTP2_BDP_PROBE, 0);
    arguments.SetInt(GRPC_ARG_HTTP2_STREAM_LOOKAHEAD_BYTES, 64 << 10);
    const auto stub = v1::StreamService::NewStub(
        grpc::CreateCustomChannel(address_, grpc::InsecureChannelCredentials(), arguments));
    v1::StreamVolumesRequest lossless;
    lossless.set_delivery(v1::DELIVERY_LOSSLESS);
    std::optional<Stalled> newest, every;
    double min_change = 1, max_growth_mb = 0;
    for (int round = 0; round < kMaxRounds && min_change >= 0.05; ++round) {
        const Phase alone = observe(client, *daemon, kStalledSeconds / 2);
        newest.emplace(*stub, v1::StreamVolumesRequest());
        every.emplace(*stub, lossless);
        const Phase stalled = observe(client, *daemon, kStalledSeconds);
        const double change = stalled.results_per_second / alone.results_per_second - 1;
        const double growth_mb = stalled.max_resident_mb - alone.max_resident_mb;
        min_change = std::min(min_change, std::abs(change));
        max_growth_mb = std::max(max_growth_mb, growth_mb);
        fmt::print(
            "                     alone   two stalled subscribers\n"
            "results a second  {:8.2f}   {:8.2f} ({:+.2f} %)\n"
            "CPU ms a result   {:8.2f}   {:8.2f}\n"
            "resident MB       {:8.1f}   {:8.1f} ({:+.1f})\n",
            alone.results_per_second, stalled.results_per_second, 100 * change, alone.cpu_ms_per_result,
            stalled.cpu_ms_per_result, alone.max_resident_mb, stalled.max_resident_mb, growth_mb);
        EXPECT_GT(stalled.results_per_second, 1) << "it does not stand still";
        if (min_change >= 0.05 && round + 1 < kMaxRounds) newest.reset(), every.reset();
    }
    EXPECT_LT(min_change, 0.05);
    EXPECT_LT(max_growth_mb, 50);

    // A returning subscriber gets the latest result, and the number of missed ones.
    v1::StreamVolumesResponse message;
    std::uint64_t sequence = 0, missed = 0, received = 0, newest_now = client.status()->latest_sequence();
    while (newest->reader->Read(&message)) {
        if (received++ > 0) {
            EXPECT_GE(message.header().sequence() - sequence - 1, message.header().missed_count());
            missed += message.header().missed_count();
        }
        sequence = message.header().sequence();
        if (sequence >= newest_now) break;
    }
    EXPECT_GE(sequence, newest_now);
    EXPECT_GT(missed, 0u);
    newest.reset();
    every.reset();
    daemon->signal(SIGTERM);
    EXPECT_EQ(daemon->wait(std::chrono::milliseconds(2000)), 0);
}

}  // namespace
}  // namespace kinevox
