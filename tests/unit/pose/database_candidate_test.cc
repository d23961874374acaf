// The pose stage and the pose database together: a body in a pose that only the database knows is found by
// it.
#include <gtest/gtest.h>

#include "common/geometry.h"
#include "server/pipeline/convert.h"
#include "server/pose/database/database_search.h"
#include "server/pose/pose_stage.h"
#include "tests/support/seen_body.h"
#include "tests/unit/pose/database_fixture.h"

namespace kinevox {
namespace {

// Upside down: far from every pose that the fit tries of itself.
BodyCoordinates handstand() {
    BodyCoordinates q{};
    q[2] = 1.05;
    q[kDofRootRotation] = radians(180);
    q[kDofRootRotation + 2] = radians(40);
    q[kDofShoulderL] = q[kDofShoulderR] = radians(175);
    q[kDofHipL] = radians(50), q[kDofHipR] = radians(-20);
    return q;
}

class DatabaseCandidateTest : public ::testing::Test {
  protected:
    DatabaseCandidateTest() {
        for (const Camera& camera : scene_.cameras) models_.push_back(to_kernel(camera));
        // What is taken of the whole body's model counts for the database's, too.
        database_ = build_pose_database(models_, scene_.model->shape(), small_options(40)).value();
        const LibraryPose added{"handstand", handstand(), true};
        EXPECT_TRUE(add_poses(database_, {&added, 1}).ok());
        options_.body = scene_.model->shape();
        options_.filtered = false;
    }

    std::shared_ptr<BodyPose> show(PoseStage& stage, const BodyCoordinates* q) {
        std::vector<kernels::Silhouettes> silhouettes(scene_.cameras.size());
        std::vector<PoseView> views(scene_.cameras.size());
        Vec3 centre;
        if (q) {
            std::vector<BodyCapsule> capsules;
            scene_.model->capsules(scene_.model->forward(*q), capsules);
            centre = body_centre(capsules);
            for (std::size_t c = 0; c < views.size(); ++c)
                silhouettes[c] = testing::silhouette_of(scene_.cameras[c], capsules);
        }
        for (std::size_t c = 0; c < views.size(); ++c)
            views[c] = {&models_[c], silhouettes[c].sharp_pixels > 0 ? &silhouettes[c] : nullptr};
        const std::int64_t time_ns = 33'333'333LL * frame_;
        return stage.process(1, frame_++, time_ns, views, {}, {}, centre);
    }

    // A person who stands, is gone for a second, and comes back upside down: the error of the 15th frame set
    // after that, m; nothing if no pose is found.
    std::optional<double> error_after_return(PoseProposer* proposer) {
        PoseStage stage(scene_.cameras, 30, options_);
        stage.set_proposer(proposer);
        const BodyCoordinates before = scene_.standing(), after = handstand();
        for (int n = 0; n < 5; ++n) EXPECT_TRUE(show(stage, &before));
        for (int n = 0; n < 30; ++n) EXPECT_FALSE(show(stage, nullptr));
        for (int n = 0; n < 14; ++n) show(stage, &after);
        if (!show(stage, &after)) return std::nullopt;
        return scene_.error_m(stage.tracked()->fit.posture, after);
    }

    testing::SeenBody scene_;
    std::vector<kernels::CameraModel> models_;
    PoseDatabase database_;
    PoseStageOptions options_;
    std::int64_t frame_ = 0;
};

TEST_F(DatabaseCandidateTest, IsUsedWhenNothingElseFits) {
    DatabaseSearch search(database_, SearchOptions());
    const auto with = error_after_return(&search), without = error_after_return(nullptr);
    ASSERT_TRUE(with) << "a pose is found";
    EXPECT_LT(*with, 0.04);
    EXPECT_TRUE(!without || *without > 0.2) << "the database is what found it; without: " << *without;
}

}  // namespace
}  // namespace kinevox
