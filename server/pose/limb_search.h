// Global search for an arm or a leg outside the basin of convergence: tries many configurations of one limb
// while the rest of the body is fixed.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/ray_capsule.h"
#include "server/pose/silhouette_rays.h"

namespace kinevox {

// kWhole: any direction of the limb. kLower: the upper arm or thigh keeps its direction and only rotates
// about its axis, and elbow or knee bend: cheap enough for every frame set.
enum class LimbSearchScope { kWhole, kLower };
enum class Limb { kArmL, kArmR, kLegL, kLegR };
inline constexpr std::array<Limb, 4> kLimbs{Limb::kArmL, Limb::kArmR, Limb::kLegL, Limb::kLegR};

struct LimbSegments {
    int upper, lower, end;
    bool arm, left;
};
LimbSegments segments_of(Limb limb);

// Not thread safe; keeps its memory.
class LimbSearch {
  public:
    // The posture whose limb explains the silhouettes best, or nothing if none is clearly better than the
    // current one. `robust_m` as in PoseCost.
    std::optional<BodyPosture> improve(const BodyModel& model, const BodyPosture& posture,
                                       std::span<const SilhouetteRays> views, Limb limb,
                                       LimbSearchScope scope, double robust_m);
    // Searches both limbs, `first` without the other: resolves swapped or coinciding limbs, which a search of
    // one limb cannot. The result must be confirmed by a fit.
    std::optional<BodyPosture> improve_pair(const BodyModel& model, const BodyPosture& posture,
                                            std::span<const SilhouetteRays> views, Limb first, Limb second,
                                            double robust_m);

  private:
    void split(const BodyModel& model, const BodyPosture& posture, std::span<const Limb> limbs,
               std::vector<BodyCapsule>* others);
    void set_rest(std::span<const SilhouetteRays> views, std::span<const BodyCapsule> rest);
    std::optional<BodyPosture> cheapest(const BodyModel& model, const BodyPosture& posture,
                                        std::span<const SilhouetteRays> views, Limb which,
                                        LimbSearchScope scope, double robust_m, double& best);
    // Incomplete, but at least `limit`, where it exceeds that.
    double cost(std::span<const SilhouetteRays> views, std::span<const BodyCapsule> capsules, double robust_m,
                double limit);
    void thin_out(std::span<const SilhouetteRays> views);

    std::vector<ContourRays> rays_;                  // per camera, a subset of its rays
    std::vector<std::vector<float>> rest_distance_;  // per camera and ray: of the body without the limb
    std::vector<float> distance_;
    std::vector<int> which_;
    std::vector<BodyCapsule> capsules_;
};

}  // namespace kinevox
