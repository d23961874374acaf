#include "server/tools/calibrate/person_verb.h"

#include <fmt/format.h>

#include "server/calibration/diagnosis.h"
#include "server/calibration/hull_agreement.h"
#include "server/calibration/person_extrinsics.h"
#include "server/calibration/session_silhouettes.h"
#include "server/tools/calibrate/certificate_files.h"
#include "server/tools/calibrate/console.h"

namespace kinevox::calibrate {

absl::Status person_extrinsics(const PersonArguments& arguments) {
    if (!(arguments.height_m > 0))
        return absl::InvalidArgumentError(
            "--person needs --height, the subject's in metres: it gives the scale");
    const SolveProgress progress = console_progress(arguments.quiet);
    const auto lenses = session_cameras(arguments.session, arguments.lenses);
    if (!lenses.ok()) return lenses.status();
    auto seen = untracked_silhouettes(arguments.session, arguments.moments, progress);
    if (!seen.ok()) return seen.status();
    PersonExtrinsicsOptions options;
    options.height_m = arguments.height_m;
    PersonExtrinsicsOptions rough = options;
    rough.max_moments = rough.first_moments;
    rough.tell_uncertainty = false;
    auto solved = extrinsics_from_person(*lenses, *seen, rough, progress);
    if (!solved.ok()) return solved.status();
    if (solved->left_out.empty()) {
        // Now that places are known, the subject can be followed: without shadows and whatever else moves.
        seen = tracked_silhouettes(arguments.session, solved->cameras, arguments.moments, progress);
        if (!seen.ok()) return seen.status();
        auto better = improve_extrinsics_from_person(*std::move(solved), *seen, options, progress);
        if (!better.ok()) return better.status();
        solved = *std::move(better);
    }
    Certificate certificate;
    certificate.made_by = "person";
    certificate.cameras = solved->cameras;
    certificate.findings = solved->findings;
    certificate.world_is_set = true;
    certificate.subject_height_m = arguments.height_m;
    if (solved->left_out.empty()) {
        certificate.hull = hull_agreement(solved->cameras, *seen);
        fmt::print("hull and silhouettes agree to {:.4f} (IoU, {} frames)\n", certificate.hull->mean_iou,
                   certificate.hull->frames);
    }
    fmt::print(
        "outlines miss by {:.2f} px; the subject was whole in {} moments and walked over {:.1f} m by {:.1f} "
        "m\n",
        solved->miss_px, solved->moments, solved->walked_m, solved->walked_wide_m);
    if (solved->uncertainty)
        fmt::print(
            "the two halves of the recording give places that differ by {:.0f} mm and {:.2f} degrees at "
            "worst\n",
            solved->uncertainty->centre_mm, solved->uncertainty->turn_deg);
    for (const Camera& camera : solved->cameras) {
        const Vec3 centre = camera.centre_in_world();
        fmt::print("{:12} {:.3f} {:.3f} {:.3f} m\n", camera.name, centre.x, centre.y, centre.z);
    }
    for (Finding& finding : check_world(certificate.cameras, std::nullopt, std::nullopt))
        certificate.findings.push_back(std::move(finding));
    return write_calibration(certificate, arguments.out);
}

}  // namespace kinevox::calibrate
