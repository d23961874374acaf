// Access to what the shadow rule sees, for learning its weights (tests/accuracy/shadow_rule.py).
#pragma once

#include "kernels/cpu/shadow.h"
#include "kernels/segmentation.h"

namespace kinevox::kernels::cpu {

// `observer` gets each doubtful pixel of the segmenter's frames, from several threads. Throws
// std::invalid_argument for a segmenter of another device.
void observe_shadows(Segmenter& segmenter, ShadowJudge::Observer observer);

}  // namespace kinevox::kernels::cpu
