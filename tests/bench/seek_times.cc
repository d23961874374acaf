// How long a recording takes from a seek to the frame set: seek_times SESSION.toml [SEEKS]. Prints one line:
// frames, the time to open it and to its first frame set in ms; then median, 99 of 100 and worst in ms of
// seeks to frames drawn at random, and the same of steps back by one.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdlib>
#include <random>
#include <string>
#include <vector>

#include "common/stopwatch.h"
#include "server/cameras/replay_source.h"
#include "server/cameras/session_source.h"

namespace {

using namespace kinevox;

[[noreturn]] void fail(const std::string& why) {
    fmt::print(stderr, "seek_times: {}\n", why);
    std::exit(1);
}

// From the request to the frame set, ms.
double seek(ReplaySource& source, std::int64_t frame) {
    const Stopwatch stopwatch;
    if (absl::Status sought = source.seek(frame); !sought.ok()) fail(std::string(sought.message()));
    const auto set = source.next();
    const double ms = stopwatch.ms();
    if (!set.ok()) fail(std::string(set.status().message()));
    if (set->recorded_frame != frame) fail(fmt::format("frame {} came as {}", frame, *set->recorded_frame));
    return ms;
}

std::string summary(std::vector<double> ms) {
    std::ranges::sort(ms);
    const auto at = [&](double part) {
        return ms[static_cast<std::size_t>(part * static_cast<double>(ms.size() - 1))];
    };
    return fmt::format("{:.1f} {:.1f} {:.1f}", at(0.5), at(0.99), ms.back());
}

}  // namespace

int main(int argc, char** argv) {
    if (argc < 2 || argc > 3) fail("give SESSION.toml [SEEKS]");
    silence_video_libraries();
    const Stopwatch stopwatch;
    auto source = ReplaySource::open(argv[1], {.paused = true});
    if (!source.ok()) fail(std::string(source.status().message()));
    const double open_ms = stopwatch.ms();
    if (const auto first = (*source)->next(); !first.ok()) fail(std::string(first.status().message()));
    const double first_ms = stopwatch.ms();
    const std::int64_t frames = (*source)->position().frame_count;
    const int seeks = argc == 3 ? std::atoi(argv[2]) : 200;
    if (seeks < 1 || frames < 2) fail("there is nothing to seek");
    std::mt19937 random(1);
    std::uniform_int_distribution<std::int64_t> any(1, frames - 1);
    std::vector<double> far, back;
    for (int k = 0; k < seeks; ++k) far.push_back(seek(**source, any(random)));
    for (std::int64_t frame = any(random), k = 0; k < seeks; ++k) {
        if (k % 50 == 0)
            seek(**source,
                 frame = std::max<std::int64_t>(any(random), std::min<std::int64_t>(51, frames - 1)));
        frame = std::max<std::int64_t>(frame - 1, 0);
        back.push_back(seek(**source, frame));
    }
    fmt::print("{} {:.0f} {:.0f} {} {}\n", frames, open_ms, first_ms, summary(std::move(far)),
               summary(std::move(back)));
    return 0;
}
