// Measures whether a camera has rotated, from the static scene in an earlier image.
#pragma once

#include <memory>
#include <optional>

#include "common/camera.h"
#include "kernels/types.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

struct SceneShift {
    double rotation_deg = 0;  // of the camera since the first image
    double shift_px = 0;      // at the image centre; for a roll, half way to the border
    double explained = 0;     // fraction of the image difference that the rotation explains, 0..1
};

// One camera's. Not thread safe.
class StaticScene {
  public:
    explicit StaticScene(const Camera& camera);
    ~StaticScene();
    StaticScene(StaticScene&&) noexcept;
    StaticScene& operator=(StaticScene&&) noexcept;

    // `ignored`: px, the subject; not compared. Later images are compared with the first ones. Empty if too
    // little of the scene is visible. About 3 ms.
    std::optional<SceneShift> measure(const Image& image, const kernels::Rect& ignored);

  private:
    struct Levels;
    Camera camera_;
    std::unique_ptr<Levels> first_;
};

}  // namespace kinevox
