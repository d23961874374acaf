#include "server/calibration/certificate/person_refine.h"

#include <utility>

#include "server/calibration/person/diagnosis.h"
#include "server/calibration/person/hull_iou.h"
#include "server/calibration/person/silhouette_overlays.h"

namespace kinevox {

void check_with_person(const SilhouetteSet& silhouettes, std::optional<double> height_m,
                       Certificate& certificate) {
    const std::vector<Camera>& cameras = certificate.cameras;
    const auto extent = subject_extent(cameras, silhouettes);
    if (extent) certificate.stature_m = extent->highest_m - extent->lowest_m;
    certificate.world_defined = true;
    certificate.overlays = silhouette_overlays(cameras, silhouettes);
    for (Finding& finding : check_world(cameras, extent, height_m))
        certificate.findings.push_back(std::move(finding));
}

absl::StatusOr<PersonRefinement> refine_from_person(const std::vector<Camera>& cameras,
                                                    const SilhouetteSet& silhouettes, int frame_sets,
                                                    std::optional<double> height_m,
                                                    const SolveProgress& progress) {
    PersonRefinement out;
    Certificate& certificate = out.certificate;
    certificate.method = "person";
    certificate.cameras = cameras;
    // Measured on held-out frame sets.
    SilhouetteSet fitted, kept_out;
    for (std::size_t m = 0; m < silhouettes.frame_sets.size(); ++m)
        (m % 2 ? kept_out : fitted).frame_sets.push_back(silhouettes.frame_sets[m]);
    certificate.hull_iou_before = certificate.hull_iou = hull_iou(cameras, kept_out);
    // The error of the given poses is unknown: the prior with the largest hull IoU wins.
    for (const auto& [angle_deg, shift_m] :
         {std::pair{0.25, 0.02}, std::pair{1.0, 0.07}, std::pair{5.0, 0.35}}) {
        SilhouetteRefineOptions options;
        options.max_frame_sets = frame_sets;
        options.prior_angle_deg = angle_deg, options.prior_shift_m = shift_m;
        auto refined = refine_from_silhouettes(cameras, fitted, options, progress);
        if (!refined.ok()) return refined.status();
        const HullIou hull = hull_iou(refined->cameras, kept_out);
        if (!(hull.mean_iou > certificate.hull_iou->mean_iou)) continue;
        certificate.hull_iou = hull;
        certificate.cameras = refined->cameras;
        out.better = *std::move(refined);
    }
    if (!out.better)
        certificate.findings.push_back(
            {Verdict::kCaution, "no_improvement", "",
             "no other extrinsics fit the silhouettes better: nothing was changed",
             "for a better result, record a person who walks through the whole space"});
    check_with_person(silhouettes, height_m, certificate);
    return out;
}

}  // namespace kinevox
