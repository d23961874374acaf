// usage: make_volume_vectors FOLDER
// Encoded volumes for decoders in other languages: NAME.kvxv, and beside each what our own decoder says of
// it, NAME.surface: uint32 number of surface voxels, then int32 i, j, k and uint8 r, g, b, 0 of each; 0 0 0
// without colours.
#include <cstdio>
#include <cstring>
#include <string>

#include "common/files.h"
#include "common/volume_codec.h"
#include "tests/support/person_volume.h"

namespace {

using kinevox::Volume;

std::string surface_of(const Volume& volume) {
    const auto voxels = kinevox::surface_voxels(volume);
    std::string out;
    const auto add = [&](auto value) { out.append(reinterpret_cast<const char*>(&value), sizeof value); };
    add(static_cast<std::uint32_t>(voxels.size()));
    for (std::size_t n = 0; n < voxels.size(); ++n) {
        const kinevox::Rgb colour = volume.colours.empty() ? kinevox::Rgb{0, 0, 0} : volume.colours[n];
        for (const std::int32_t at : {voxels[n].i, voxels[n].j, voxels[n].k}) add(at);
        for (const std::uint8_t value : {colour.r, colour.g, colour.b, std::uint8_t{0}}) add(value);
    }
    return out;
}

// Full, half and single octants and cells, at the box's edges.
Volume blocks() {
    return kinevox::testing::volume_of({{-0.5, 2, 0}, 0.02, {24, 16, 40}}, [](kinevox::Vec3 p) {
        return p.z < 0.16 || (p.z > 0.32 && p.x < -0.3) || (p.z > 0.7 && p.y > 2.2);
    });
}

}  // namespace

int main(int argc, char** argv) {
    if (argc != 2) {
        std::fprintf(stderr, "usage: make_volume_vectors FOLDER\n");
        return 1;
    }
    const std::filesystem::path folder = argv[1];
    std::filesystem::create_directories(folder);
    const std::pair<const char*, Volume> volumes[] = {{"empty", Volume{}},
                                                      {"blocks", blocks()},
                                                      {"person_50mm", kinevox::testing::person_volume(0.05)},
                                                      {"person_20mm", kinevox::testing::person_volume(0.02)},
                                                      {"person_10mm", kinevox::testing::person_volume(0.01)}};
    for (const auto& [name, volume] : volumes)
        for (const bool with_colours : {false, true}) {
            const std::string bytes = kinevox::encode_volume(volume, {.with_colours = with_colours});
            const auto decoded =
                kinevox::decode_volume({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
            const std::string stem = std::string(name) + (with_colours ? "_coloured" : "");
            auto status = decoded.status();
            status.Update(kinevox::write_file_atomically(folder / (stem + ".kvxv"), bytes));
            if (status.ok())
                status = kinevox::write_file_atomically(folder / (stem + ".surface"), surface_of(*decoded));
            if (!status.ok()) {
                std::fprintf(stderr, "%s\n", status.ToString().c_str());
                return 1;
            }
        }
}
