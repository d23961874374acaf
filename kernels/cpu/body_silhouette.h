#pragma once

#include <vector>

#include "kernels/body_silhouette.h"
#include "kernels/shared/camera.h"

namespace kinevox::kernels {

std::unique_ptr<BodySilhouetteRenderer> make_body_silhouette_renderer_cpu();

// Throws std::invalid_argument, see BodySilhouetteRenderer::render().
void check_capsules(std::span<const TaperedCapsule> body);

// Making a projector of a distorted camera takes longer than a silhouette: those seen last are kept.
class ProjectorCache {
  public:
    Projector get(const CameraModel& camera);

  private:
    std::vector<std::pair<CameraModel, Projector>> distorted_;
    std::size_t next_ = 0;
};

}  // namespace kinevox::kernels
