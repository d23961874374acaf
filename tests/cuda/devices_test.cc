// Several GPUs, emulated: streams and memory belong to one, each thread begins with cuda:0, and a use of
// another GPU's ends the program (emulator/devices.h).
#include "tests/cuda/emulator/devices.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "kernels/bench/frame_set_rig.h"
#include "kernels/body_silhouette.h"
#include "kernels/cuda/forms.h"
#include "kernels/device_error.h"
#include "kernels/device_facts.h"
#include "kernels/moments.h"
#include "kernels/stages.h"
#include "kernels/tests/capsule_body.h"

namespace kinevox::kernels {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

constexpr int kFrames = 3;
constexpr bench::FrameSetSize kSize{3, 96, 72, 0.05f, 2};

struct BrokenGpu {
    explicit BrokenGpu(int gpu) { cuda_emulator::break_device(gpu); }
    ~BrokenGpu() { cuda_emulator::repair_devices(); }
};

void on_fresh_thread(const std::function<void()>& work) {
    std::thread([&] {
        ASSERT_EQ(cuda_emulator::current_device(), 0);
        work();
    }).join();
}

std::vector<std::uint64_t> bits_of_rig(const bench::FrameSetRig& rig) {
    std::vector<std::uint64_t> bits;
    for (const Brick& brick : rig.volume().bricks)
        bits.insert(bits.end(), brick.occupancy, brick.occupancy + 8);
    for (const Colour& colour : rig.volume().colours)
        bits.push_back(colour.r | colour.g << 8 | static_cast<std::uint64_t>(colour.b) << 16);
    return bits;
}

// A stage of each kind on one GPU. Made, used and destroyed by different threads.
struct AllStages {
    std::unique_ptr<bench::FrameSetRig> rig;
    std::unique_ptr<RewindableSegmenter> segmenter;
    std::unique_ptr<HullCarver> carver;
    std::unique_ptr<BodySilhouetteRenderer> renderer;
    std::unique_ptr<MomentCalculator> calculator;

    void make(Device device) {
        rig = std::make_unique<bench::FrameSetRig>(device, kSize);
        segmenter = make_rewindable_segmenter(device, 64, 48, 3);
        HullOptions one_view;
        one_view.min_views = 1;
        carver = make_hull_carver(device, one_view);
        renderer = make_body_silhouette_renderer(device);
        calculator = make_moment_calculator(device);
    }
    void destroy() { *this = {}; }

    // Each on a thread of its own; returns what they computed.
    std::vector<std::vector<double>> run() {
        std::vector<std::vector<double>> out;
        const auto keep = [&](const auto& values) { out.emplace_back(values.begin(), values.end()); };
        for (int frame = 0; frame < kFrames; ++frame)
            on_fresh_thread([&] {
                rig->run();
                keep(bits_of_rig(*rig));
            });
        const float from[3] = {4, 0, 1.4f}, at[3] = {0, 0, 0.9f};
        const CameraModel camera = testing::camera_looking(from, at, 64, 48, 60);
        std::vector<std::uint8_t> mask(64 * 48), image(3 * 64 * 48, 90);
        BodyView body{&camera, mask.data(), {}};
        on_fresh_thread(
            [&] { renderer->render(testing::capsule_person(0, 0, 0.4f, 0.3f), std::span(&body, 1)); });
        keep(mask);
        const ImageView view{image.data(), 64, 48, 3, 3 * 64};
        Silhouettes silhouettes;
        on_fresh_thread([&] { segmenter->set_camera(camera); });
        on_fresh_thread([&] { segmenter->learn(std::span(&view, 1)); });
        for (std::size_t n = 0; n < mask.size(); ++n)
            if (mask[n]) image[3 * n] = 230;
        for (int frame = 0; frame < 2; ++frame) {
            on_fresh_thread([&] { segmenter->begin_frame(view, {}); });
            on_fresh_thread([&] { segmenter->decide({}, silhouettes); });
            on_fresh_thread([&] { segmenter->end_frame(silhouettes); });
            keep(silhouettes.probability);
            on_fresh_thread([&] { segmenter->forget_frames(); });
        }
        VoxelVolume volume;
        Lattice lattice{{-0.8f, -0.8f, 0}, 0.1f, {16, 16, 24}};
        const HullView hull{&camera, mask.data(), body.bounds};
        on_fresh_thread([&] { carver->carve(std::span(&hull, 1), lattice, volume); });
        EXPECT_FALSE(volume.bricks.empty());
        for (const Brick& brick : volume.bricks)
            out.emplace_back(brick.occupancy, brick.occupancy + kBrickEdge);
        const MomentView moments{mask.data(), 64, body.bounds};
        std::vector<SilhouetteMoments> computed;
        on_fresh_thread([&] { calculator->compute(std::span(&moments, 1), computed); });
        keep(computed.at(0).values);
        return out;
    }
};

std::vector<std::vector<double>> results_on(Device device) {
    AllStages stages;
    on_fresh_thread([&] { stages.make(device); });
    auto out = stages.run();
    on_fresh_thread([&] { stages.destroy(); });
    return out;
}

TEST(CudaDevices, EveryStageKeepsToItsGpuOnAnyThread) {
    for (const int gpu : {1, 0}) {
        cuda_emulator::take_devices_with_context();
        const auto results = results_on(Device::cuda(gpu));
        EXPECT_THAT(cuda_emulator::take_devices_with_context(), ElementsAre(gpu));
        EXPECT_EQ(results, results_on(Device::cuda(1 - gpu)));
    }
}

TEST(CudaDevices, FactoryMakesStagesOfItsGpu) {
    const auto factory = make_stage_factory(Device::cuda(1));
    EXPECT_EQ(factory->device(), Device::cuda(1));
    EXPECT_EQ(factory->problem(), "");
    EXPECT_EQ(factory->name(), "CUDA emulator");
    cuda_emulator::take_devices_with_context();
    on_fresh_thread([&] {
        const auto before = factory->memory();
        const auto segmenter = factory->segmenter(64, 48, 3, {});
        EXPECT_GT(factory->memory().used_bytes, before.used_bytes);
        factory->hull_carver({});
        factory->voxel_colourer({});
        factory->rewindable_segmenter(64, 48, 3, {});
    });
    EXPECT_THAT(cuda_emulator::take_devices_with_context(), ElementsAre(1));
}

TEST(CudaDevices, TwoGpusWorkAtOnceAndInTurns) {
    bench::FrameSetRig first(Device::cuda(0), kSize), second(Device::cuda(1), kSize);
    const auto run = [](bench::FrameSetRig& rig) {
        for (int frame = 0; frame < kFrames; ++frame) rig.run();
    };
    std::thread one([&] { run(first); }), two([&] { run(second); });
    one.join();
    two.join();
    EXPECT_FALSE(bits_of_rig(first).empty());
    EXPECT_EQ(bits_of_rig(first), bits_of_rig(second));
    for (int frame = 0; frame < kFrames; ++frame) {
        first.run();
        second.run();
        EXPECT_EQ(bits_of_rig(first), bits_of_rig(second)) << frame;
    }
}

TEST(CudaDevices, AbsentGpuIsReportedWithThoseOfTheMachine) {
    const std::string problem = make_stage_factory(Device::cuda(2))->problem();
    EXPECT_EQ(problem,
              "there is no cuda:2; this machine has 2 GPUs, cuda:0 to cuda:1 (`kinevox devices` lists them)");
    EXPECT_EQ(make_stage_factory(Device::cuda(2))->name(), "");
    const auto message_of = [](const auto& make) -> std::string {
        try {
            make();
        } catch (const DeviceError& error) {
            return error.what();
        }
        return "no DeviceError";
    };
    const Device absent = Device::cuda(2);
    for (const std::string& message :
         {message_of([&] { make_hull_carver(absent); }), message_of([&] { make_voxel_colourer(absent); }),
          message_of([&] { make_segmenter(absent, 64, 48, 3); }),
          message_of([&] { make_body_silhouette_renderer(absent); }),
          message_of([&] { make_moment_calculator(absent); })})
        EXPECT_THAT(message, AllOf(HasSubstr(problem), HasSubstr("use device cpu")));
}

TEST(CudaDevices, ContextOfAnotherGpuIsRejected) {
    EXPECT_THAT([] { make_segmenter(Device::cuda(1), 64, 48, 3, {}, make_device_context_cuda(0)); },
                ::testing::ThrowsMessage<std::invalid_argument>(HasSubstr("not that of cuda:1")));
}

TEST(CudaDevices, FailureOfOneGpuLeavesTheOtherUsable) {
    bench::FrameSetRig first(Device::cuda(0), kSize), second(Device::cuda(1), kSize);
    first.run();
    second.run();
    const BrokenGpu broken(1);
    EXPECT_THAT([&] { second.run(); },
                ::testing::ThrowsMessage<DeviceError>(HasSubstr("an illegal memory access was encountered")));
    EXPECT_THROW(make_hull_carver(Device::cuda(1)), DeviceError);
    first.run();
    EXPECT_FALSE(bits_of_rig(first).empty());
}

TEST(CudaDevices, FactsListEachGpuWithItsMemory) {
    const auto segmenter = make_segmenter(Device::cuda(1), 64, 48, 3);
    const CudaFacts facts = cuda_facts();
    EXPECT_EQ(facts.problem, "");
    EXPECT_EQ(facts.driver_version, "12.4");
    EXPECT_EQ(facts.runtime_version, "12.4");
    ASSERT_EQ(facts.gpus.size(), 2u);
    for (const GpuFacts& gpu : facts.gpus) {
        EXPECT_EQ(gpu.device, Device::cuda(&gpu == &facts.gpus[0] ? 0 : 1));
        EXPECT_EQ(gpu.name, "CUDA emulator");
        EXPECT_EQ(gpu.capability_major, 9);
        EXPECT_EQ(gpu.problem, "");
        EXPECT_EQ(gpu.total_bytes, std::uint64_t{8} << 30);
    }
    EXPECT_EQ(facts.gpus[1].pci_bus_id, "0000:02:00.0");
    EXPECT_LT(facts.gpus[1].free_bytes, facts.gpus[0].free_bytes) << "the segmenter's memory is on cuda:1";
    EXPECT_EQ(recommended_device(facts), Device::cuda(0));
}

TEST(CudaDevices, FactsNameProblemOfGpuThatFails) {
    const BrokenGpu broken(0);
    const CudaFacts facts = cuda_facts();
    ASSERT_EQ(facts.gpus.size(), 2u);
    EXPECT_THAT(facts.gpus[0].problem, HasSubstr("an illegal memory access was encountered"));
    EXPECT_THAT(facts.gpus[0].remedy, HasSubstr("restart the machine"));
    EXPECT_EQ(facts.gpus[0].free_bytes, 0u);
    EXPECT_THAT(facts.gpus[1].problem, IsEmpty());
    EXPECT_EQ(recommended_device(facts), Device::cuda(1));
}

}  // namespace
}  // namespace kinevox::kernels
