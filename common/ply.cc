#include "common/ply.h"

#include <fmt/format.h>

#include <bit>
#include <cstring>

#include "common/atomic_file.h"

namespace kinevox {
namespace {

static_assert(std::endian::native == std::endian::little, "points are written as they lie in memory");

constexpr Rgb kGrey{180, 180, 180};
constexpr std::size_t kPointBytes = 3 * sizeof(float) + 3;

}  // namespace

absl::Status write_volume_ply(const Volume& volume, const std::filesystem::path& file) {
    const std::vector<VoxelIndex> surface = surface_voxels(volume);
    const bool coloured = !volume.colours.empty();
    if (coloured && volume.colours.size() != surface.size())
        return absl::InvalidArgumentError(
            fmt::format("{}: not written: the volume has {} colours for {} surface voxels", file.string(),
                        volume.colours.size(), surface.size()));
    std::string out = fmt::format(
        "ply\nformat binary_little_endian 1.0\ncomment surface voxel centres, edge {} m\nelement vertex {}\n"
        "property float x\nproperty float y\nproperty float z\n"
        "property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        volume.grid.voxel_m, surface.size());
    std::size_t at = out.size();
    out.resize(at + surface.size() * kPointBytes);
    for (std::size_t i = 0; i < surface.size(); ++i, at += kPointBytes) {
        const VoxelIndex v = surface[i];
        const Vec3 centre =
            volume.grid.origin_in_world + volume.grid.voxel_m * Vec3{v.i + 0.5, v.j + 0.5, v.k + 0.5};
        const float position[3] = {static_cast<float>(centre.x), static_cast<float>(centre.y),
                                   static_cast<float>(centre.z)};
        const Rgb colour = coloured ? volume.colours[i] : kGrey;
        const std::uint8_t channels[3] = {colour.r, colour.g, colour.b};
        std::memcpy(out.data() + at, position, sizeof position);
        std::memcpy(out.data() + at + sizeof position, channels, sizeof channels);
    }
    return write_file_atomically(file, out);
}

}  // namespace kinevox
