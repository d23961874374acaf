// Legs that look like the floor: the studio's person, with the background painted over them.
#include <gtest/gtest.h>

#include <algorithm>
#include <memory>

#include "server/cameras/studio/studio_source.h"
#include "server/pipeline/pipeline.h"

namespace kinevox {
namespace {

constexpr double kHip_m = 0.8, kShank_m = 0.25;  // above the floor

// Paints the background over what a camera sees between two heights at a place on the floor.
Image without(const Image& image, const Image& background, const Camera& camera, Vec3 at, double low_m,
              double high_m) {
    const std::size_t stride = static_cast<std::size_t>(image.width) * image.channels;
    const auto offset_of = [&](double height_m) {
        const auto pixel = camera.project({at.x, at.y, height_m});
        return stride * (pixel ? std::clamp(static_cast<int>(pixel->y), 0, image.height) : image.height);
    };
    const std::size_t begin = offset_of(high_m), end = std::max(begin, offset_of(low_m));
    auto data = std::make_shared<std::uint8_t[]>(stride * image.height);
    std::copy_n(image.data.get(), stride * image.height, data.get());
    std::copy(background.data.get() + begin, background.data.get() + end, data.get() + begin);
    return {image.width, image.height, image.channels, data};
}

double lowest_m(const Volume& volume) {
    int lowest = volume.grid.size[2];
    for (const VoxelIndex& voxel : surface_voxels(volume)) lowest = std::min(lowest, voxel.k);
    return volume.grid.origin_in_world.z + volume.grid.voxel_m * lowest;
}

TEST(MissingLegs, FindsFeetApartFromTrunk) {
    constexpr int kFeetShown = 8, kFrames = 12;
    StudioSourceOptions options;
    options.studio.width = 320, options.studio.height = 240;
    options.studio.motion = "stand";
    options.background_frames = 10;
    options.pacing = Pacing::kAsFastAsPossible;
    const auto source = *StudioSource::create(options);
    PipelineOptions small;
    small.voxel_m = 0.02;
    small.pose = false;
    const auto pipeline = *Pipeline::create(source->cameras(), source->fps(), small);
    const auto background = *source->background();
    ASSERT_TRUE(pipeline->learn_background(background).ok());
    for (int frame = 0; frame < kFrames; ++frame) {
        FrameSet set = *source->next();
        const Vec3 root = source->truth(set.sequence).joints_in_world[0];
        const double low_m = frame < kFeetShown ? -1 : kShank_m;
        for (std::size_t c = 0; c < set.images.size(); ++c)
            set.images[c] =
                without(set.images[c], background[c][0], source->cameras()[c], root, low_m, kHip_m);
        const FrameResultPtr result = *pipeline->process(std::move(set));
        ASSERT_TRUE(result->first_subject() && result->first_subject()->volume) << frame;
        const double lowest = lowest_m(*result->first_subject()->volume);
        if (frame == kFeetShown - 1) {
            EXPECT_GT(lowest, 0.5);
        }
        if (frame > kFeetShown) {
            EXPECT_LT(lowest, 0.1) << frame;
        }
    }
}

}  // namespace
}  // namespace kinevox
