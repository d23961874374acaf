// What the fit reads from a sharp silhouette: viewing rays through its border, and how far any pixel is from
// it.
#pragma once

#include <cstdint>
#include <vector>

#include "common/camera.h"
#include "kernels/segmentation.h"
#include "server/pose/pose_options.h"

namespace kinevox {

// Rays through the silhouette's border, one origin. `outward` is normal to the ray and points away from the
// silhouette. A border that is only the picture's edge is none.
struct ContourRays {
    Vec3 origin_in_world;
    std::vector<float> direction[3], outward[3];  // world, unit
    std::size_t size() const { return direction[0].size(); }
};

// Signed distance in px to the silhouette's border, positive inside. Outside of the picture nothing is known,
// so the picture's edge is no border.
class SilhouetteDistance {
  public:
    void build(const std::uint8_t* mask, int width, int height, const kernels::Rect& bounds, int side);
    // Bilinear, with its gradient; outside of the map the distance to the map is subtracted. False: outside
    // of the picture, or no silhouette.
    bool at(Vec2 pixel, double& distance_px, Vec2& gradient) const;

  private:
    int picture_width_ = 0, picture_height_ = 0;
    int x0_ = 0, y0_ = 0, cell_ = 1, columns_ = 0, rows_ = 0;
    std::vector<float> distance_;
};

struct SilhouetteRays {
    const Camera* camera = nullptr;  // null: nothing is seen by this camera
    ContourRays contour;
    SilhouetteDistance distance;
    double metres_per_px = 0;  // at the rays' usual distance, set by the caller
};

// From the sharp silhouette. `out` keeps its memory. With no sharp pixels out.camera is null.
void read_silhouette(const Camera& camera, const kernels::Silhouettes& silhouettes,
                     const SilhouetteRayOptions& options, SilhouetteRays& out);

}  // namespace kinevox
