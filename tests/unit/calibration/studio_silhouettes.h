// Silhouettes of the virtual studio's person, exact, without pictures.
#pragma once

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "server/calibration/silhouette_set.h"
#include "server/cameras/studio/studio.h"

namespace kinevox::testing {

struct StudioSilhouettes {
    std::vector<Camera> cameras;  // as they stand
    SilhouetteSet set;
};

inline StudioSilhouettes studio_silhouettes(const std::string& motion, int cameras, int moments, int every) {
    studio::StudioOptions options;
    options.motion = motion, options.cameras = cameras;
    options.width = 480, options.height = 360, options.distortion = 0.05;
    StudioSilhouettes out;
    auto studio = studio::Studio::create(options);
    EXPECT_TRUE(studio.ok()) << studio.status();
    if (!studio.ok()) return out;
    out.cameras = (*studio)->cameras();
    for (int m = 0; m < moments; ++m) {
        std::vector<SilhouettePicture> pictures;
        for (auto& mask : (*studio)->masks(every * m)) pictures.push_back({std::move(mask), false});
        out.set.moments.push_back(std::move(pictures));
    }
    return out;
}

}  // namespace kinevox::testing
