// live_probe CONFIG --seconds N: takes frame sets from the cameras of a daemon's configuration, without the
// pipeline behind them, and prints what came as a line of JSON. With --pattern each image is compared, byte
// by byte, with what the fake camera sent. --until-complete and --until-error end it sooner.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <map>
#include <mutex>
#include <thread>
#include <vector>

#include "common/stopwatch.h"
#include "server/cameras/aravis/live_source.h"
#include "server/config/daemon_config.h"
#include "tests/support/fake_gige/scene.h"

namespace {

using namespace kinevox;

// Every byte as it was sent, in Mono8: three equal channels.
bool is_as_sent(const Image& image) {
    const std::size_t pixels = static_cast<std::size_t>(image.width) * image.height;
    std::uint64_t number = 0;
    for (int i = 7; i >= 0; --i) number = number << 8 | image.data[3 * i];
    const auto sent = testing::pattern_image(number, pixels);
    for (std::size_t i = 0; i < pixels; ++i)
        if (image.data[3 * i] != sent[i] || image.data[3 * i + 1] != sent[i]) return false;
    return true;
}

}  // namespace

int main(int argc, char** argv) {
    std::string file;
    double seconds = 10;
    bool pattern = false;
    std::uint64_t until_complete = 0;
    int until_error = 0;
    CLI::App app("Receives frame sets from live cameras and reports statistics", "live_probe");
    app.add_option("config", file, "kinevoxd.toml")->required();
    app.add_option("--seconds", seconds);
    app.add_flag("--pattern", pattern, "compare with the fake cameras' test pattern (Mono8)");
    app.add_option("--until-complete", until_complete, "end after this many complete frame sets");
    app.add_option("--until-error", until_error, "end when this camera, from 1, is reported as absent");
    CLI11_PARSE(app, argc, argv);
    const auto config = read_config(file);
    if (!config.ok()) return fmt::print(stderr, "live_probe: {}\n", config.status().ToString()), 1;
    auto source = open_live_source(config->source.cameras);
    if (!source.ok()) return fmt::print(stderr, "live_probe: {}\n", source.status().ToString()), 1;
    const Stopwatch running;
    std::atomic<bool> seen_enough = false;
    std::mutex printing;
    (*source)->set_on_camera_event([&](const CameraEvent& event) {
        const std::scoped_lock lock(printing);
        fmt::print("{{\"event\": {}, \"camera\": {}, \"at_s\": {:.3f}, \"message\": \"{}\"}}\n",
                   static_cast<int>(event.kind), event.camera, running.seconds(), event.message);
        std::fflush(stdout);
        if (static_cast<int>(event.camera) + 1 == until_error &&
            event.kind == CameraEvent::Kind::kDisconnected)
            seen_enough = true;
    });
    std::jthread clock([&](const std::stop_token& stop) {
        while (!stop.stop_requested() && !seen_enough && running.seconds() < seconds)
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
        (*source)->stop();
    });
    std::uint64_t sets = 0, complete = 0, wrong = 0, gaps = 0, last = 0;
    double max_gap_ms = 0, last_s = 0;
    for (;;) {
        auto set = (*source)->next();
        if (!set.ok()) break;
        const double now_s = running.seconds();
        if (sets > 0) {
            gaps += set->sequence - last - 1;
            max_gap_ms = std::max(max_gap_ms, (now_s - last_s) * 1000);
        }
        last = set->sequence;
        last_s = now_s;
        ++sets;
        complete += std::ranges::none_of(set->images, &Image::empty);
        if (complete == until_complete && until_complete > 0) seen_enough = true;
        if (pattern)
            for (const Image& image : set->images) wrong += !image.empty() && !is_as_sent(image);
    }
    clock.request_stop();
    const std::scoped_lock lock(printing);
    fmt::print(
        "{{\"sets\": {}, \"complete\": {}, \"gaps\": {}, \"wrong\": {}, \"max_gap_ms\": {:.1f}, "
        "\"cameras\": [",
        sets, complete, gaps, wrong, max_gap_ms);
    const auto links = (*source)->camera_connections();
    for (std::size_t c = 0; c < links.size(); ++c) {
        const CameraConnection& l = links[c];
        fmt::print(
            "{}{{\"image_count\": {}, \"lost_image_count\": {}, \"incomplete_image_count\": {}, "
            "\"late_image_count\": {}, \"unmatched_image_count\": {}, \"warmup_image_count\": {}, "
            "\"disconnect_count\": {}, \"resend_request_count\": {}, \"resent_packet_count\": {}, "
            "\"missing_packet_count\": {}, \"buffer_underrun_count\": {}, \"packet_size_bytes\": {}, "
            "\"mean_skew_ms\": {:.3f}, \"max_abs_skew_ms\": {:.3f}, \"mean_arrival_delay_ms\": {:.2f}, "
            "\"max_arrival_delay_ms\": {:.2f}, \"clock_drift_ppm\": {:.1f}, \"timestamp_source\": {}, "
            "\"error_message\": \"{}\"}}",
            c ? ", " : "", l.image_count, l.lost_image_count, l.incomplete_image_count, l.late_image_count,
            l.unmatched_image_count, l.warmup_image_count, l.disconnect_count, l.resend_request_count,
            l.resent_packet_count, l.missing_packet_count, l.buffer_underrun_count, l.packet_size_bytes,
            l.mean_skew_ms, l.max_abs_skew_ms, l.mean_arrival_delay_ms, l.max_arrival_delay_ms,
            l.clock_drift_ppm, static_cast<int>(l.timestamp_source), l.error_message);
    }
    fmt::print("]}}\n");
    return 0;
}
