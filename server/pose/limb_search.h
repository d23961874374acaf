// Global search for an arm or a leg outside the basin of convergence: tries many configurations of one limb
// while the rest of the body is fixed.
#pragma once

#include <array>
#include <optional>
#include <span>
#include <vector>

#include "server/pose/body_model.h"
#include "server/pose/capsule_balls.h"
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
    bool has(int segment) const { return segment == upper || segment == lower || segment == end; }
};
LimbSegments segments_of(Limb limb);

// The rotations of a limb's segments against their parents.
struct LimbRotations {
    Mat3 upper, lower, end;
};
// Appends a limb's capsules in the world, as BodyModel::capsules() has them; `world_from_parent`: of the
// trunk's segment that bears the limb.
void append_capsules(const BodyModel& model, const Rigid3& world_from_parent, const LimbSegments& limb,
                     const LimbRotations& rotations, std::vector<BodyCapsule>& out);

// Not thread safe; keeps its memory.
class LimbSearch {
  public:
    // The posture whose limb explains the silhouettes best, or nothing if none is clearly better than the
    // current one. `robust_m` as in PoseCost.
    std::optional<BodyPosture> improve(const BodyModel& model, const BodyPosture& posture,
                                       std::span<const SilhouetteRays> views, Limb limb,
                                       LimbSearchScope scope, double robust_m);
    // Postures with the configurations of the whole limb that the silhouettes allow, the cheapest first: for
    // evidence beyond the silhouettes to choose from. Their number is limited.
    std::vector<BodyPosture> plausible(const BodyModel& model, const BodyPosture& posture,
                                       std::span<const SilhouetteRays> views, Limb limb, double robust_m);
    // Searches both limbs, `first` without the other: resolves swapped or coinciding limbs, which a search of
    // one limb cannot. The result must be confirmed by a fit.
    std::optional<BodyPosture> improve_pair(const BodyModel& model, const BodyPosture& posture,
                                            std::span<const SilhouetteRays> views, Limb first, Limb second,
                                            double robust_m);

  private:
    // The rotations of a limb's upper and lower segment against their parents; the end one is straight.
    struct Configuration {
        Mat3 upper, lower;
    };

    // Per camera, a subset of its rays, and their distances to the body without the limb.
    struct RaySubset {
        ContourRays rays;
        std::vector<float> rest_distance;
    };

    void split(const BodyModel& model, const BodyPosture& posture, std::span<const Limb> limbs,
               std::vector<BodyCapsule>* others);
    void set_rest(std::span<const BodyCapsule> rest);
    double begin(const BodyModel& model, const BodyPosture& posture, std::span<const SilhouetteRays> views,
                 std::span<const Limb> limbs, double robust_m);
    void list_configurations(const BodyPosture& posture, const LimbSegments& limb, LimbSearchScope scope);
    void place_configurations(const BodyModel& model, const PosedBody& posed, const LimbSegments& limb);
    double prepare(const BodyModel& model, const BodyPosture& posture, std::span<const SilhouetteRays> views,
                   const LimbSegments& limb, LimbSearchScope scope, double robust_m);
    double cost_of(std::size_t configuration, double rest_cost, double robust_m, double limit);
    static BodyPosture with(const Configuration& configuration, const LimbSegments& limb,
                            BodyPosture posture);
    std::optional<BodyPosture> cheapest(const BodyModel& model, const BodyPosture& posture,
                                        std::span<const SilhouetteRays> views, Limb which,
                                        LimbSearchScope scope, double robust_m, double& best);
    void measure_outside(std::span<const SilhouetteRays> views, std::span<const BodyCapsule> capsules,
                         std::size_t per_body, double robust_m);
    double keep_reached(Vec3 joint_in_world, double robust_m);
    double contour_cost(std::span<const RaySubset> subsets, std::span<const BodyCapsule> capsules,
                        double robust_m, double limit);
    double cost(std::span<const SilhouetteRays> views, std::span<const BodyCapsule> capsules,
                double robust_m);
    void thin_out(std::span<const SilhouetteRays> views);

    std::vector<RaySubset> thinned_, reached_;
    std::vector<float> distance_;
    std::vector<int> which_;
    std::vector<BodyCapsule> capsules_;
    std::vector<Configuration> configurations_;
    std::vector<BodyCapsule> placed_;   // of all configurations, one after the other
    std::vector<double> outside_cost_;  // of each
    std::vector<int> order_;            // by that
    CapsuleBalls balls_;
};

}  // namespace kinevox
