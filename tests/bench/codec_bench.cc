// What sending a volume costs: encoding, decoding and coarsening a person-like volume, and the bytes of its
// message.
#include <benchmark/benchmark.h>

#include "common/volume_codec.h"
#include "tests/support/person_volume.h"

namespace kinevox {
namespace {

std::span<const std::uint8_t> bytes_of(const std::string& text) {
    return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

// Arguments: voxel edge in mm, with colours or not.
void encode(benchmark::State& state) {
    const Volume person = testing::person_volume(state.range(0) / 1000.0);
    const VolumeCodecOptions options{.with_colours = state.range(1) != 0};
    std::size_t bytes = 0;
    for (auto _ : state) bytes = encode_volume(person, options).size();
    state.counters["bytes"] = static_cast<double>(bytes);
    state.counters["voxels"] = static_cast<double>(voxel_count(person));
    state.counters["bricks"] = static_cast<double>(person.bricks.size());
    state.counters["surface"] = static_cast<double>(person.colours.size());
}

void decode(benchmark::State& state) {
    const Volume person = testing::person_volume(state.range(0) / 1000.0);
    const std::string message = encode_volume(person, {.with_colours = state.range(1) != 0});
    for (auto _ : state) benchmark::DoNotOptimize(decode_volume(bytes_of(message)));
}

void coarsen(benchmark::State& state) {
    const Volume person = testing::person_volume(state.range(0) / 1000.0);
    for (auto _ : state) benchmark::DoNotOptimize(coarsened(person, 1));
}

BENCHMARK(encode)->Unit(benchmark::kMillisecond)->ArgNames({"mm", "colours"})->ArgsProduct({{10, 5}, {0, 1}});
BENCHMARK(decode)->Unit(benchmark::kMillisecond)->ArgNames({"mm", "colours"})->ArgsProduct({{10, 5}, {0, 1}});
BENCHMARK(coarsen)->Unit(benchmark::kMillisecond)->ArgName("mm")->Arg(10)->Arg(5);

}  // namespace
}  // namespace kinevox
