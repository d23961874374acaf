// A body as cameras around it see it: silhouettes that the body model itself throws.
#pragma once

#include <memory>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/silhouette_rays.h"

namespace kinevox::testing {

// Cameras of 320 x 240 px around the origin, 4 m away, looking at the height of the hips.
std::vector<Camera> camera_ring(int count = 4);

// A pixel is set where its viewing ray goes through a capsule.
kernels::Silhouettes silhouette_of(const Camera& camera, const std::vector<BodyCapsule>& capsules);

// Who is seen by a ring of cameras.
struct SeenBody {
    std::vector<Camera> cameras = camera_ring();
    std::shared_ptr<const BodyModel> model = std::make_shared<BodyModel>(default_body_shape(1.75));
    double hidden_below_m = 0;  // above the floor: not in the silhouettes

    BodyCoordinates standing() const;  // one arm and one leg forward
    BodyCoordinates t_pose() const;
    std::vector<SilhouetteRays> see(const BodyPosture& posture) const;
    std::vector<SilhouetteRays> see(const BodyCoordinates& q) const {
        return see(posture_from_coordinates(q));
    }
    double error_m(const BodyPosture& posture, const BodyCoordinates& truth) const;  // mean over the joints
};

}  // namespace kinevox::testing
