// Segmentation of four cameras' images of 640 x 480, as the pipeline calls it: the cameras side by side.
#include <benchmark/benchmark.h>

#include <algorithm>
#include <memory>
#include <vector>

#include "kernels/bench/bench_device.h"
#include "kernels/segmentation.h"
#include "kernels/stages.h"
#include "kernels/tests/segmentation_scene.h"

#ifdef KINEVOX_HAVE_TBB
#include <oneapi/tbb/parallel_for.h>
#endif

namespace kinevox::kernels {
namespace {

constexpr int kCameras = 4, kWidth = 640, kHeight = 480, kImages = 8;
constexpr Rect kBody{280, 120, 350, 350};

struct Rig {
    explicit Rig(int samples) : images(kCameras), segmenters(kCameras), out(kCameras) {
        SegmentationOptions options;
        options.samples = samples;
        const auto stages = make_stage_factory(bench::device());
        for (int c = 0; c < kCameras; ++c) {
            testing::TestRoom room(kWidth, kHeight, 3, 5 + c);
            const auto clip = room.clip(std::max(samples, 8));
            segmenters[c] = stages->segmenter(kWidth, kHeight, 3, options);
            segmenters[c]->learn(testing::views_of(clip));
            for (int i = 0; i < kImages; ++i) {
                images[c].push_back(room.image(1 + 0.01 * (i % 3)));
                room.shade(images[c].back(), {320, 330, 430, 380}, 0.7);
                room.draw(images[c].back(), {kBody.x0 + i, kBody.y0, kBody.x1 + i, kBody.y1}, 40, 60, 150);
            }
        }
    }

    void run(int frame, bool tracked) {
        SegmentationPrior prior;
        if (tracked) prior.region = {kBody.x0 - 40, kBody.y0 - 40, kBody.x1 + 40, kBody.y1 + 40};
        prior.full_pass = !tracked;
        const auto each = [&](const auto& body) {
#ifdef KINEVOX_HAVE_TBB
            oneapi::tbb::parallel_for(0, kCameras, body);
#else
            for (int c = 0; c < kCameras; ++c) body(c);
#endif
        };
        each([&](int c) { segmenters[c]->begin_frame(images[c][frame % kImages].view(), prior); });
        std::vector<FrameDecision> decisions(kCameras);
        for (int c = 0; c < kCameras; ++c) decisions[c].segmenter = segmenters[c].get();
        segmenters[0]->decide_together(decisions);
        each([&](int c) {
            segmenters[c]->decide({}, out[c]);
            segmenters[c]->end_frame(out[c]);
        });
    }

    std::vector<std::vector<testing::TestImage>> images;
    std::vector<std::unique_ptr<Segmenter>> segmenters;
    std::vector<Silhouettes> out;
};

// Arguments: samples N, and whether a track confines the work to a region.
void segment_four_cameras(benchmark::State& state) {
    Rig rig(static_cast<int>(state.range(0)));
    int frame = 0;
    bench::Samples samples;
    for (auto _ : state) samples.time([&] { rig.run(frame++, state.range(1) != 0); });
    samples.report(state);
}
BENCHMARK(segment_four_cameras)
    ->ArgsProduct({{8, 32, 64}, {0, 1}})
    ->ArgNames({"samples", "tracked"})
    ->Unit(benchmark::kMillisecond)
    ->UseRealTime();

}  // namespace
}  // namespace kinevox::kernels
