// Poses that a fit may start from, and who proposes them.
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "common/geometry.h"
#include "kernels/segmentation.h"
#include "kernels/types.h"
#include "server/pose/body_model.h"

namespace kinevox {

struct PoseCandidate {
    BodyCoordinates
        coordinates{};    // the root's place may be rough: the fitter moves the body to the silhouettes first
    double distance = 0;  // the proposer's own measure, smaller is better
};

// One camera's part of a frame set, as the pose stage sees it. Pointers stay valid for the call only.
struct PoseView {
    const kernels::CameraModel* camera = nullptr;
    const kernels::Silhouettes* silhouettes = nullptr;  // null: the camera has no picture or was left out
};

// Something that knows poses for silhouettes: the pose database.
class PoseProposer {
  public:
    virtual ~PoseProposer() = default;
    // At most `most` candidates, best first. `views` in the order of the cameras, `centre_in_world` the
    // tracked centre.
    virtual std::vector<PoseCandidate> propose(std::span<const PoseView> views, Vec3 centre_in_world,
                                               int most) = 0;
};

}  // namespace kinevox
