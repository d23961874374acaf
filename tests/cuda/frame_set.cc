// Frame sets of the walking person, one after the other, for profilers; on the emulator also the calls of
// CUDA's runtime. usage: frame_set CAMERAS WIDTH HEIGHT VOXEL_MM FRAMES [DEVICE] Prints FRAME SEGMENTATION_MS
// HULL_MS COLOURING_MS; emulated: FRAME LAUNCHES COPIES WAITS UPLOADED_BYTES DOWNLOADED_BYTES.
#include <cstdio>
#include <cstdlib>
#include <exception>

#include "kernels/bench/frame_set_rig.h"

#ifdef KINEVOX_EMULATED
#include "tests/cuda/emulator/calls.h"
#endif

using namespace kinevox::kernels;

int main(int argc, char** argv) {
    const auto device = device_of_name(argc > 6 ? argv[6] : "cuda");
    if (argc < 6 || !device) {
        std::fprintf(stderr,
                     "usage: frame_set CAMERAS WIDTH HEIGHT VOXEL_MM FRAMES [DEVICE]     default: cuda\n");
        return 2;
    }
    bench::FrameSetSize size;
    size.cameras = std::atoi(argv[1]);
    size.width = std::atoi(argv[2]);
    size.height = std::atoi(argv[3]);
    size.voxel_m = 1e-3f * static_cast<float>(std::atof(argv[4]));
    try {
        bench::FrameSetRig rig(*device, size);
        for (int frame = 0; frame < std::atoi(argv[5]); ++frame) {
#ifdef KINEVOX_EMULATED
            cuda_emulator::take_calls();
            rig.run();
            const cuda_emulator::Calls calls = cuda_emulator::take_calls();
            std::printf("%d\t%ld\t%ld\t%ld\t%zu\t%zu\n", frame, calls.launches,
                        calls.uploads + calls.downloads + calls.memsets, calls.waits, calls.uploaded_bytes,
                        calls.downloaded_bytes);
#else
            const bench::StageTimes times = rig.run();
            std::printf("%d\t%.3f\t%.3f\t%.3f\n", frame, times.segmentation_ms, times.hull_ms,
                        times.colouring_ms);
#endif
        }
    } catch (const std::exception& error) {
        std::fprintf(stderr, "frame_set: %s\n", error.what());
        return 1;
    }
    return 0;
}
