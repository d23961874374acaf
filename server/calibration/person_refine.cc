#include "server/calibration/person_refine.h"

#include <utility>

#include "server/calibration/agreement_pictures.h"
#include "server/calibration/diagnosis.h"
#include "server/calibration/hull_agreement.h"

namespace kinevox {

void judge_by_person(const SilhouetteSet& silhouettes, std::optional<double> height_m,
                     Certificate& certificate) {
    const std::vector<Camera>& cameras = certificate.cameras;
    const auto extent = subject_extent(cameras, silhouettes);
    if (extent) certificate.subject_height_m = extent->highest_m - extent->lowest_m;
    certificate.world_is_set = true;
    certificate.pictures = agreement_pictures(cameras, silhouettes);
    for (Finding& finding : check_world(cameras, extent, height_m))
        certificate.findings.push_back(std::move(finding));
}

absl::StatusOr<PersonRefinement> refine_from_person(const std::vector<Camera>& cameras,
                                                    const SilhouetteSet& silhouettes, int moments,
                                                    std::optional<double> height_m,
                                                    const SolveProgress& progress) {
    PersonRefinement out;
    Certificate& certificate = out.certificate;
    certificate.made_by = "person";
    certificate.cameras = cameras;
    // Measured on moments that the fit does not see.
    SilhouetteSet fitted, kept_out;
    for (std::size_t m = 0; m < silhouettes.moments.size(); ++m)
        (m % 2 ? kept_out : fitted).moments.push_back(silhouettes.moments[m]);
    certificate.hull_before = certificate.hull = hull_agreement(cameras, kept_out);
    // How far the cameras may be from where they are believed to be is not known: what the hull agrees with
    // best is taken.
    for (const auto& [angle_deg, shift_m] :
         {std::pair{0.25, 0.02}, std::pair{1.0, 0.07}, std::pair{5.0, 0.35}}) {
        SilhouetteRefineOptions options;
        options.max_moments = moments;
        options.prior_angle_deg = angle_deg, options.prior_shift_m = shift_m;
        auto refined = refine_from_silhouettes(cameras, fitted, options, progress);
        if (!refined.ok()) return refined.status();
        const HullAgreement hull = hull_agreement(refined->cameras, kept_out);
        if (!(hull.mean_iou > certificate.hull->mean_iou)) continue;
        certificate.hull = hull;
        certificate.cameras = refined->cameras;
        out.better = *std::move(refined);
    }
    if (!out.better)
        certificate.findings.push_back(
            {Verdict::kCare, "unchanged", "",
             "the silhouettes fit no other places better: nothing was changed",
             "if it should be better, record a person who walks through the whole space"});
    judge_by_person(silhouettes, height_m, certificate);
    return out;
}

}  // namespace kinevox
