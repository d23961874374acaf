// Renders silhouettes of a body of tapered capsules for any camera: fills the pose database and compares
// poses. Thousands per second.
#pragma once

#include <cstdint>
#include <memory>
#include <span>

#include "kernels/types.h"

namespace kinevox::kernels {

// The union of the balls whose centre goes from a to b while the radius goes from radius_a to radius_b.
struct TaperedCapsule {
    float a[3] = {0, 0, 0}, b[3] = {0, 0, 0};  // m, world
    float radius_a = 0, radius_b = 0;          // m, not negative
};

// One camera's view of the body. A pixel is set if the ray through its centre hits the body in front of the
// camera.
struct BodyView {
    const CameraModel* camera = nullptr;
    std::uint8_t* mask = nullptr;  // camera->width * camera->height bytes, written: 0 or 255
    Rect bounds;                   // written: the smallest box around what was set, empty if there is nothing
};

// Not thread safe; keeps its working memory, and remembers distorted cameras that it has seen.
class BodySilhouetteRenderer {
  public:
    virtual ~BodySilhouetteRenderer() = default;
    // Throws std::invalid_argument for a capsule whose numbers are not finite or whose radius is negative,
    // and for a camera whose size or calibration cannot be used.
    virtual void render(std::span<const TaperedCapsule> body, std::span<BodyView> views) = 0;
};

// Throws std::runtime_error where the device is absent. The CPU form draws each capsule's contour as a
// polygon that is off by at most about 0.1 px; the CUDA form tests each pixel's ray.
std::unique_ptr<BodySilhouetteRenderer> make_body_silhouette_renderer(Device device);

}  // namespace kinevox::kernels
