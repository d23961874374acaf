// Whether an image shows a person beside the one who is tracked.
#pragma once

#include "common/camera.h"
#include "kernels/segmentation.h"
#include "kernels/types.h"

namespace kinevox {

// Whether the foreground outside `subject` has a part of the size of a person, who may be several times as
// far away as the room is deep. `s` must be of a search of the whole image; only its probability is used,
// since its masks lack what does not touch the expected subject.
bool shows_person_outside(const Camera& camera, const kernels::Silhouettes& s, const kernels::Rect& subject);

}  // namespace kinevox
