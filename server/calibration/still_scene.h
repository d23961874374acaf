// Whether a camera still looks where it looked: its picture of everything that stands still against an
// earlier one.
#pragma once

#include <memory>
#include <optional>

#include "common/camera.h"
#include "kernels/types.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

struct SceneShift {
    double turn_deg = 0;  // of the camera since the first picture
    double shift_px =
        0;  // at the picture's middle; a turn about the optical axis as far as half way to the border
    double explained = 0;  // part of the difference between the pictures that the turn takes away, 0..1
};

// One camera's. Not thread safe.
class StillScene {
  public:
    explicit StillScene(const Camera& camera);
    ~StillScene();
    StillScene(StillScene&&) noexcept;
    StillScene& operator=(StillScene&&) noexcept;

    // Where `ignored` lies (the subject, px) nothing is compared. The first pictures become what later ones
    // are compared with. Nothing where too little of the scene is seen. Some 3 ms.
    std::optional<SceneShift> measure(const Picture& picture, const kernels::Rect& ignored);

  private:
    struct Levels;
    Camera camera_;
    std::unique_ptr<Levels> first_;
};

}  // namespace kinevox
