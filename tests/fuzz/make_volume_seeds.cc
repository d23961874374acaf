// usage: make_volume_seeds FOLDER
// Writes encoded volumes as seeds of volume_fuzzer: small ones without zstd, so that masks and colours can be
// mutated, and larger ones with zstd frames.
#include <cstdio>
#include <random>
#include <string>

#include "common/files.h"
#include "common/volume_codec.h"
#include "tests/support/person_volume.h"

namespace {

kinevox::Volume ball(double radius_m) {
    kinevox::Volume volume =
        kinevox::testing::volume_of({{-0.08, -0.08, -0.08}, 0.01, {16, 16, 16}},
                                    [&](kinevox::Vec3 p) { return kinevox::norm(p) < radius_m; });
    std::mt19937 random(1);
    for (std::size_t i = kinevox::surface_voxels(volume).size(); i > 0; --i)
        volume.colours.push_back({static_cast<std::uint8_t>(random()), static_cast<std::uint8_t>(random()),
                                  static_cast<std::uint8_t>(random())});
    return volume;
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 2) {
        std::fprintf(stderr, "usage: make_volume_seeds FOLDER\n");
        return 1;
    }
    const std::filesystem::path folder = argv[1];
    const kinevox::Volume volumes[] = {kinevox::Volume{}, ball(0.02), ball(0.07),
                                       kinevox::testing::person_volume(0.05),
                                       kinevox::testing::person_volume(0.02)};
    int number = 0;
    for (const kinevox::Volume& volume : volumes)
        for (const bool with_colours : {false, true}) {
            const std::string bytes = kinevox::encode_volume(volume, {.with_colours = with_colours});
            const auto status =
                kinevox::write_file_atomically(folder / ("seed" + std::to_string(number++) + ".kvxv"), bytes);
            if (!status.ok()) {
                std::fprintf(stderr, "%s\n", status.ToString().c_str());
                return 1;
            }
        }
}
