#include <fmt/format.h>

#include "server/calibration/person/diagnosis.h"
#include "server/calibration/person/person_extrinsics.h"
#include "server/calibration/person/session_silhouettes.h"
#include "server/calibration/person/silhouette_hull.h"
#include "server/tools/calibrate/certificate_files.h"
#include "server/tools/calibrate/verbs.h"
#include "server/tools/console.h"

namespace kinevox::calibrate {

absl::Status person_extrinsics(const PersonArguments& arguments) {
    if (!(arguments.stature_m > 0))
        return absl::InvalidArgumentError("--person needs --stature (m): it defines the scale");
    const SolveProgress progress = console_progress(arguments.output.quiet);
    const auto intrinsics = session_cameras(arguments.session, arguments.intrinsics);
    if (!intrinsics.ok()) return intrinsics.status();
    auto seen = untracked_silhouettes(arguments.session, arguments.frame_sets, progress);
    if (!seen.ok()) return seen.status();
    PersonExtrinsicsOptions options;
    options.height_m = arguments.stature_m;
    PersonExtrinsicsOptions rough = options;
    rough.max_frame_sets = rough.first_frame_sets;
    rough.estimate_uncertainty = false;
    auto solved = extrinsics_from_person(*intrinsics, *seen, rough, progress);
    if (!solved.ok()) return solved.status();
    if (solved->excluded_cameras.empty()) {
        // With known poses the subject is tracked, which removes shadows and other motion.
        seen = tracked_silhouettes(arguments.session, solved->cameras, arguments.frame_sets, progress);
        if (!seen.ok()) return seen.status();
        auto better = improve_extrinsics_from_person(*std::move(solved), *seen, options, progress);
        if (!better.ok()) return better.status();
        solved = *std::move(better);
    }
    Certificate certificate;
    certificate.method = "person";
    certificate.cameras = solved->cameras;
    certificate.findings = solved->findings;
    certificate.world_defined = true;
    certificate.stature_m = arguments.stature_m;
    if (solved->excluded_cameras.empty()) {
        certificate.hull_iou = hull_iou(solved->cameras, *seen);
        arguments.output.print("hull IoU {:.4f} ({} frame sets)\n", certificate.hull_iou->mean_iou,
                               certificate.hull_iou->frames);
    }
    arguments.output.print(
        "silhouette residual {:.2f} px; the whole subject was seen in {} frame sets and walked over {:.1f} m "
        "by {:.1f} m\n",
        solved->residual_px, solved->frame_sets, solved->walked_m, solved->walked_wide_m);
    if (solved->uncertainty)
        arguments.output.print(
            "the two halves of the session give camera poses that differ by up to {:.0f} mm and {:.2f} "
            "degrees\n",
            solved->uncertainty->centre_mm, solved->uncertainty->rotation_deg);
    for (const Camera& camera : solved->cameras) {
        const Vec3 centre = camera.centre_in_world();
        arguments.output.print("{:12} {:.3f} {:.3f} {:.3f} m\n", camera.name, centre.x, centre.y, centre.z);
    }
    for (Finding& finding : check_world(certificate.cameras, std::nullopt, std::nullopt))
        certificate.findings.push_back(std::move(finding));
    return write_calibration(certificate, arguments.output);
}

}  // namespace kinevox::calibrate
