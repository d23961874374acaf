// What the virtual studio costs: a frame set of the daemon's source, and its start.
#include <benchmark/benchmark.h>

#include "server/cameras/studio/studio.h"

namespace kinevox::studio {
namespace {

void BM_FrameSet(benchmark::State& state, const char* motion) {
    StudioOptions options;
    options.motion = motion;
    options.cameras = static_cast<int>(state.range(0));
    const auto studio = *Studio::create(options);
    std::int64_t frame = 0;
    for (auto _ : state) benchmark::DoNotOptimize(studio->draw(frame++, false));
}
BENCHMARK_CAPTURE(BM_FrameSet, walk, "walk")->Arg(4)->Arg(8)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(BM_FrameSet, jumping_jack, "jumping_jack")->Arg(4)->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(BM_FrameSet, sprint_start, "sprint_start")->Arg(4)->Unit(benchmark::kMillisecond);

void BM_Start(benchmark::State& state, const char* motion) {
    StudioOptions options;
    options.motion = motion;
    for (auto _ : state) benchmark::DoNotOptimize(Studio::create(options));
}
BENCHMARK_CAPTURE(BM_Start, room, "walk")->Unit(benchmark::kMillisecond)->UseRealTime();
BENCHMARK_CAPTURE(BM_Start, lane, "run")->Unit(benchmark::kMillisecond)->UseRealTime();

}  // namespace
}  // namespace kinevox::studio
