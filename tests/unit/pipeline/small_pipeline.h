// A pipeline on a few small frame sets of the virtual studio, for the tests of its devices.
#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "server/cameras/studio/studio_source.h"
#include "server/pipeline/gpu.h"
#include "server/pipeline/pipeline.h"

namespace kinevox::testing {

inline constexpr int kFrames = 12;

inline std::unique_ptr<StudioSource> studio() {
    StudioSourceOptions options;
    options.studio.width = 160, options.studio.height = 120;
    options.background_frames = 10;
    options.pacing = Pacing::kAsFastAsPossible;
    return *StudioSource::create(options);
}

inline PipelineOptions small_options(std::shared_ptr<Gpu> gpu) {
    PipelineOptions options;
    options.voxel_m = 0.04;
    options.pose = false;
    options.gpu = std::move(gpu);
    return options;
}

// The results of the studio's first frame sets; empty where one fails.
inline std::vector<FrameResultPtr> run(const PipelineOptions& options,
                                       const std::function<void(int frame)>& before = {}) {
    const auto source = studio();
    auto pipeline = Pipeline::create(source->cameras(), source->fps(), options);
    EXPECT_TRUE(pipeline.ok()) << pipeline.status();
    if (!pipeline.ok()) return {};
    EXPECT_TRUE((*pipeline)->learn_background(*source->background()).ok());
    std::vector<FrameResultPtr> results;
    for (int frame = 0; frame < kFrames; ++frame) {
        if (before) before(frame);
        auto result = (*pipeline)->process(*source->next());
        EXPECT_TRUE(result.ok()) << result.status();
        if (!result.ok()) return {};
        results.push_back(*std::move(result));
    }
    return results;
}
inline std::vector<FrameResultPtr> run(std::shared_ptr<Gpu> gpu,
                                       const std::function<void(int frame)>& before = {}) {
    return run(small_options(std::move(gpu)), before);
}

inline std::vector<std::string> errors_in(const std::vector<FrameResultPtr>& results) {
    std::vector<std::string> errors;
    for (const auto& result : results)
        for (const Event& event : result->events)
            if (event.kind == EventKind::kGpuFailed) errors.push_back(event.message);
    return errors;
}

// Null: none.
inline const Volume* subject_volume(const FrameResultPtr& result) {
    return result->first_subject() ? result->first_subject()->volume.get() : nullptr;
}

inline double volume_of(const FrameResultPtr& result) {
    const Volume* const volume = subject_volume(result);
    return volume ? volume_litres(*volume) : 0;
}

inline void expect_same(const FrameResultPtr& a, const FrameResultPtr& b) {
    for (std::size_t c = 0; c < a->silhouettes.size(); ++c)
        EXPECT_EQ(a->silhouettes[c].sharp, b->silhouettes[c].sharp);
    ASSERT_EQ(subject_volume(a) != nullptr, subject_volume(b) != nullptr) << a->sequence;
    if (!subject_volume(a)) return;
    EXPECT_EQ(volume_of(a), volume_of(b)) << a->sequence;
    EXPECT_EQ(subject_volume(a)->colours, subject_volume(b)->colours) << a->sequence;
}

}  // namespace kinevox::testing
