// Exact silhouettes of the virtual studio's person, without images.
#pragma once

#include <gtest/gtest.h>

#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/cameras/studio/studio.h"
#include "server/silhouettes/silhouettes.h"

namespace kinevox::testing {

struct StudioSilhouettes {
    std::vector<Camera> cameras;  // true cameras
    SilhouetteSet set;
};

inline StudioSilhouettes studio_silhouettes(const std::string& motion, int cameras, int frame_sets,
                                            int stride) {
    studio::StudioOptions options;
    options.motion = motion, options.cameras = cameras;
    options.width = 480, options.height = 360, options.distortion = 0.05;
    StudioSilhouettes out;
    // A studio draws its room first, which takes longer than these silhouettes.
    static std::map<std::pair<std::string, int>, std::unique_ptr<studio::Studio>> studios;
    auto& studio = studios[{motion, cameras}];
    if (!studio) {
        auto made = studio::Studio::create(options);
        EXPECT_TRUE(made.ok()) << made.status();
        if (!made.ok()) return out;
        studio = *std::move(made);
    }
    out.cameras = studio->cameras();
    for (int m = 0; m < frame_sets; ++m) {
        std::vector<SilhouetteMask> images;
        for (auto& mask : studio->masks(stride * m)) images.push_back({std::move(mask), false});
        out.set.frame_sets.push_back(std::move(images));
    }
    return out;
}

}  // namespace kinevox::testing
