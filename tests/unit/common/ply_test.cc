#include <gtest/gtest.h>

#include <cstring>

#include "common/files.h"
#include "common/volume.h"
#include "tests/support/person_volume.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

TEST(Ply, HoldsSurfaceVoxels) {
    const testing::TemporaryFolder folder;
    const Volume person = testing::person_volume(0.03);
    ASSERT_TRUE(write_volume_ply(person, folder / "volumes/000000.ply").ok());
    const std::string ply = *read_file(folder / "volumes/000000.ply");
    EXPECT_NE(ply.find("format binary_little_endian 1.0\n"), std::string::npos);
    EXPECT_NE(ply.find("element vertex " + std::to_string(person.colours.size()) + "\n"), std::string::npos);
    const std::size_t points = ply.find("end_header\n") + 11;
    ASSERT_EQ(ply.size() - points, person.colours.size() * 15);
    const std::vector<VoxelIndex> surface = surface_voxels(person);
    for (const std::size_t i : {std::size_t{0}, surface.size() / 2, surface.size() - 1}) {
        float position[3];
        std::memcpy(position, ply.data() + points + 15 * i, sizeof position);
        const Vec3 centre = testing::voxel_centre_in_world(person.grid, surface[i]);
        EXPECT_FLOAT_EQ(position[0], static_cast<float>(centre.x));
        EXPECT_FLOAT_EQ(position[1], static_cast<float>(centre.y));
        EXPECT_FLOAT_EQ(position[2], static_cast<float>(centre.z));
        EXPECT_EQ(static_cast<std::uint8_t>(ply[points + 15 * i + 12]), person.colours[i].r);
        EXPECT_EQ(static_cast<std::uint8_t>(ply[points + 15 * i + 14]), person.colours[i].b);
    }
}

TEST(Ply, NamesTheUnwritablePath) {
    const testing::TemporaryFolder folder;
    folder.write("file", "");
    const absl::Status status = write_volume_ply(testing::person_volume(0.1), folder / "file/000000.ply");
    EXPECT_EQ(status.code(), absl::StatusCode::kUnavailable);
    EXPECT_NE(std::string(status.message()).find((folder / "file/000000.ply").string()), std::string::npos);
}

}  // namespace
}  // namespace kinevox
