// live_probe CONFIG --seconds N: takes frame sets from the cameras of a daemon's configuration, without the
// pipeline behind them, and prints what came as a line of JSON. With --pattern each picture is compared, byte
// by byte, with what the fake camera sent.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cstdio>
#include <map>
#include <mutex>
#include <thread>
#include <vector>

#include "common/config.h"
#include "server/cameras/aravis/live_source.h"
#include "tests/support/fake_gige/scene.h"

namespace {

using namespace kinevox;

// Every byte as it was sent, in Mono8: three equal channels.
bool is_as_sent(const Picture& picture) {
    const std::size_t pixels = static_cast<std::size_t>(picture.width) * picture.height;
    std::uint64_t number = 0;
    for (int i = 7; i >= 0; --i) number = number << 8 | picture.data[3 * i];
    const auto sent = testing::pattern_picture(number, pixels);
    for (std::size_t i = 0; i < pixels; ++i)
        if (picture.data[3 * i] != sent[i] || picture.data[3 * i + 1] != sent[i]) return false;
    return true;
}

}  // namespace

int main(int argc, char** argv) {
    std::string file;
    double seconds = 10;
    bool pattern = false;
    CLI::App app("Takes frame sets from live cameras and tells what came", "live_probe");
    app.add_option("config", file, "kinevoxd.toml")->required();
    app.add_option("--seconds", seconds);
    app.add_flag("--pattern", pattern, "compare with the fake cameras' test pattern (Mono8)");
    CLI11_PARSE(app, argc, argv);
    const auto config = read_config(file);
    if (!config.ok()) return fmt::print(stderr, "live_probe: {}\n", config.status().ToString()), 1;
    auto source = open_live_source(config->source.cameras);
    if (!source.ok()) return fmt::print(stderr, "live_probe: {}\n", source.status().ToString()), 1;
    const auto begin = std::chrono::steady_clock::now();
    const auto seconds_now = [&] {
        return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    };
    std::mutex printing;
    (*source)->set_on_camera_event([&](const CameraEvent& event) {
        const std::scoped_lock lock(printing);
        fmt::print("{{\"event\": {}, \"camera\": {}, \"at_s\": {:.3f}, \"message\": \"{}\"}}\n",
                   static_cast<int>(event.kind), event.camera, seconds_now(), event.message);
        std::fflush(stdout);
    });
    std::jthread clock([&](const std::stop_token& stop) {
        while (!stop.stop_requested() && seconds_now() < seconds)
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
        (*source)->stop();
    });
    std::uint64_t sets = 0, complete = 0, wrong = 0, gaps = 0, last = 0;
    double max_gap_ms = 0, last_s = 0;
    for (;;) {
        auto set = (*source)->next();
        if (!set.ok()) break;
        const double now_s = seconds_now();
        if (sets > 0) {
            gaps += set->sequence - last - 1;
            max_gap_ms = std::max(max_gap_ms, (now_s - last_s) * 1000);
        }
        last = set->sequence;
        last_s = now_s;
        ++sets;
        complete += std::ranges::none_of(set->pictures, &Picture::empty);
        if (pattern)
            for (const Picture& picture : set->pictures) wrong += !picture.empty() && !is_as_sent(picture);
    }
    clock.request_stop();
    const std::scoped_lock lock(printing);
    fmt::print(
        "{{\"sets\": {}, \"complete\": {}, \"gaps\": {}, \"wrong\": {}, \"longest_gap_ms\": {:.1f}, "
        "\"cameras\": [",
        sets, complete, gaps, wrong, max_gap_ms);
    const auto links = (*source)->camera_links();
    for (std::size_t c = 0; c < links.size(); ++c) {
        const CameraLink& l = links[c];
        fmt::print(
            "{}{{\"pictures\": {}, \"lost\": {}, \"incomplete\": {}, \"late\": {}, \"unmatched\": {}, "
            "\"settling\": {}, "
            "\"disconnects\": {}, \"resend_requests\": {}, \"resent\": {}, \"missing\": {}, \"underruns\": "
            "{}, "
            "\"packet\": {}, \"skew_ms\": {:.3f}, \"skew_max_ms\": {:.3f}, \"late_ms\": {:.2f}, "
            "\"late_max_ms\": {:.2f}, "
            "\"drift_ppm\": {:.1f}, \"clock\": {}, \"problem\": \"{}\"}}",
            c ? ", " : "", l.pictures, l.lost, l.incomplete, l.late, l.unmatched, l.settling, l.disconnects,
            l.resend_requests, l.packets_resent, l.packets_missing, l.underruns, l.packet_bytes, l.skew_ms,
            l.skew_max_ms, l.lateness_ms, l.lateness_max_ms, l.clock_drift_ppm, static_cast<int>(l.clock),
            l.problem);
    }
    fmt::print("]}}\n");
    return 0;
}
