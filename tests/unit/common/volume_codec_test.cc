#include "common/volume_codec.h"

#include <gtest/gtest.h>

#include <random>

#include "tests/support/person_volume.h"

namespace kinevox {
namespace {

std::span<const std::uint8_t> bytes_of(const std::string& text) {
    return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

TEST(VolumeCodec, KeepsTheShapeExactlyAndColoursWithinTwoLevels) {
    const Volume person = testing::person_volume(0.01);
    const std::string message = encode_volume(person);
    const auto decoded = decode_volume(bytes_of(message));
    ASSERT_TRUE(decoded.ok()) << decoded.status();
    EXPECT_EQ(decoded->grid, person.grid);
    EXPECT_EQ(decoded->bricks, person.bricks);
    ASSERT_EQ(decoded->colours.size(), person.colours.size());
    for (std::size_t i = 0; i < person.colours.size(); ++i) {
        EXPECT_NEAR(decoded->colours[i].r, person.colours[i].r, 2);
        EXPECT_NEAR(decoded->colours[i].g, person.colours[i].g, 2);
        EXPECT_NEAR(decoded->colours[i].b, person.colours[i].b, 2);
    }
    // What came over the wire may be sent on without a further loss.
    EXPECT_EQ(encode_volume(*decoded), message);
}

TEST(VolumeCodec, EncodesAPersonCompactly) {
    const Volume person = testing::person_volume(0.01);
    const std::size_t shape = encode_volume(person, {.with_colours = false}).size();
    const std::size_t coloured = encode_volume(person).size();
    RecordProperty("shape_bytes", static_cast<int>(shape));
    RecordProperty("coloured_bytes", static_cast<int>(coloured));
    EXPECT_LT(shape, 12000u);
    EXPECT_LT(coloured, 60000u);
}

TEST(VolumeCodec, KeepsUnusualVolumes) {
    std::mt19937_64 random(5);
    std::vector<Volume> volumes(4);
    volumes[1].grid = {{-1, 2.5, 0}, 0.02, {8, 8, 8}};  // a full brick
    volumes[1].bricks = {{0, 0, 0, {~0ull, ~0ull, ~0ull, ~0ull, ~0ull, ~0ull, ~0ull, ~0ull}}};
    volumes[2].grid = {
        {0, 0, 0}, 1e-3, {8 * kMaxBricksPerAxis, 8 * kMaxBricksPerAxis, 8 * kMaxBricksPerAxis}};
    volumes[2].bricks = {{0, 0, 0, {1}},
                         {32766, 32766, 32766, {0, 0, 0, 0, 0, 0, 0, 1ull << 63}}};  // the corners
    volumes[3].grid = {{0, 0, 0}, 0.01, {64, 64, 64}};  // noise, which no mask and no prediction helps
    for (std::int16_t z = 0; z < 8; ++z)
        for (std::int16_t x = 0; x < 8; x += 2) {
            VolumeBrick brick{x, z, z, {}};
            for (auto& slice : brick.occupancy) slice = random();
            volumes[3].bricks.push_back(brick);
        }
    for (Volume& volume : volumes) {
        for (std::size_t i = surface_voxels(volume).size(); i > 0; --i) {
            const auto level = [&] {
                return static_cast<std::uint8_t>(random() & 1 ? 255 : 0);
            };  // the extremes
            volume.colours.push_back({level(), level(), level()});
        }
        const auto decoded = decode_volume(bytes_of(encode_volume(volume)));
        ASSERT_TRUE(decoded.ok()) << decoded.status();
        EXPECT_EQ(*decoded, volume);
        Volume plain = volume;
        plain.colours.clear();
        EXPECT_EQ(*decode_volume(bytes_of(encode_volume(volume, {.with_colours = false}))), plain);
    }
}

TEST(VolumeCodec, WritesNothingForInvalidVolumes) {
    Volume volume = testing::person_volume(0.02);
    volume.bricks[3].x = -1;
    EXPECT_EQ(encode_volume(volume), "");
}

TEST(VolumeCodec, RejectsDamagedBytesWithoutFailing) {
    const std::string good = encode_volume(testing::person_volume(0.04));
    for (std::size_t length = 0; length < good.size(); length += 7)
        EXPECT_EQ(decode_volume(bytes_of(good.substr(0, length))).status().code(),
                  absl::StatusCode::kInvalidArgument);
    EXPECT_FALSE(decode_volume(bytes_of(good + "x")).ok());
    std::mt19937 random(11);
    for (int i = 0; i < 5000; ++i) {
        std::string damaged = good;
        for (int n = 1 + static_cast<int>(random() % 3); n > 0; --n)
            damaged[random() % (i % 2 ? 112 : damaged.size())] ^= static_cast<char>(1 << random() % 8);
        const auto decoded = decode_volume(bytes_of(damaged));
        if (decoded.ok()) {
            EXPECT_EQ(volume_problem(*decoded), "");
        }
    }
}

TEST(VolumeCodec, RejectsSizesBeyondTheBytes) {
    std::string message = encode_volume(testing::person_volume(0.04));
    message[48] = message[49] = message[50] = '\xff';  // 16 million bricks
    const auto decoded = decode_volume(bytes_of(message));
    EXPECT_NE(std::string(decoded.status().message()).find("exceed the limits"), std::string::npos)
        << decoded.status();
    message = encode_volume(testing::person_volume(0.04));
    message[4] = 9;
    EXPECT_NE(std::string(decode_volume(bytes_of(message)).status().message()).find("version 9"),
              std::string::npos);
}

}  // namespace
}  // namespace kinevox
