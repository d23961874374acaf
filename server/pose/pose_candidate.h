// Candidate poses for a fit, and the interface that proposes them.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "common/geometry.h"
#include "kernels/segmentation.h"
#include "kernels/types.h"
#include "server/pose/body_model.h"

namespace kinevox {

struct PoseCandidate {
    BodyCoordinates coordinates{};  // the root position may be approximate; the fitter corrects it first
    double distance = 0;            // the proposer's own measure, smaller is better
};

// Part of an image's foreground. Keeps its memory.
struct ForegroundPart {
    std::vector<std::uint8_t> mask;  // of the image's size, 255 inside, 0 outside `box`
    kernels::Rect box;               // empty: nothing
};

// One camera's input to the pose stage. Pointers are valid during the call only.
struct PoseView {
    const kernels::CameraModel* camera = nullptr;
    const kernels::Silhouettes* silhouettes = nullptr;  // null: the camera has no image or is excluded
    // Foreground that may show another subject or this one: contours there are not used, and the body may be
    // there. Null: nowhere.
    const ForegroundPart* shared = nullptr;
    kernels::ImageView image;  // without data: colours are not used
};

// Proposes poses for silhouettes; implemented by the pose database.
class PoseProposer {
  public:
    virtual ~PoseProposer() = default;
    // At most `max_candidates`, best first. `views` in the order of the cameras; `centre_in_world`: the
    // tracked centre. Thread safe: the pose stages of several subjects run in parallel.
    virtual std::vector<PoseCandidate> propose(std::span<const PoseView> views, Vec3 centre_in_world,
                                               int max_candidates) = 0;
};

}  // namespace kinevox
