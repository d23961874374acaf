// refine and check: they need a session with a person.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <memory>
#include <string>

#include "server/calibration/certificate/solved_certificate.h"
#include "server/calibration/person/diagnosis.h"
#include "server/calibration/person/session_silhouettes.h"
#include "server/calibration/person/silhouette_hull.h"
#include "server/tools/calibrate/certificate_files.h"
#include "server/tools/calibrate/session_measurements.h"
#include "server/tools/calibrate/verbs.h"
#include "server/tools/console.h"

namespace kinevox::calibrate {
namespace {

struct SessionArguments {
    std::string session, calibration;
    double stature_m = 0;
    int frame_sets = 60;
    Output output;
};

absl::StatusOr<SessionSilhouettes> open(const SessionArguments& arguments, const SolveProgress& progress) {
    return session_silhouettes(arguments.session, arguments.frame_sets, arguments.calibration, progress);
}

std::optional<double> known_stature(const SessionArguments& arguments) {
    return arguments.stature_m > 0 ? std::optional<double>(arguments.stature_m) : std::nullopt;
}

void print_hull(const char* what, const HullIou& hull, const std::vector<Camera>& cameras,
                const Output& output) {
    output.print("{}: hull IoU {:.4f} ({} frame sets):", what, hull.mean_iou, hull.frames);
    for (std::size_t c = 0; c < cameras.size(); ++c) output.print(" {} {:.3f}", cameras[c].name, hull.iou[c]);
    output.print("\n");
}

absl::Status refine(const SessionArguments& arguments) {
    if (absl::Status free = check_output(arguments.output); !free.ok()) return free;
    const SolveProgress progress = console_progress(arguments.output.quiet);
    const auto seen = open(arguments, progress);
    if (!seen.ok()) return seen.status();
    const auto refined = refine_from_person(seen->cameras, seen->set, arguments.frame_sets,
                                            known_stature(arguments), progress);
    if (!refined.ok()) return refined.status();
    const Certificate& certificate = refined->certificate;
    print_hull("before", *certificate.hull_iou_before, seen->cameras, arguments.output);
    if (const auto& better = refined->better) {
        print_hull("after ", *certificate.hull_iou, seen->cameras, arguments.output);
        arguments.output.print("silhouette residual {:.2f} px, before {:.2f} px\n", better->residual_after_px,
                               better->residual_before_px);
        for (std::size_t c = 0; c < seen->cameras.size(); ++c)
            arguments.output.print("{:12} rotated by {:.2f} degrees, moved by {:.0f} mm\n",
                                   seen->cameras[c].name, better->rotated_deg[c], 1000 * better->moved_m[c]);
    }
    return write_calibration(certificate, arguments.output);
}

// A residual without a cause is no proof against the cameras, unless the silhouettes hardly intersect; nor is
// it needed where another finding explains it.
void add_findings(std::vector<Finding> of_silhouettes, std::vector<Finding> others,
                  Certificate& certificate) {
    constexpr double kHardlyIntersect = 0.5;  // hull IoU
    const bool explained = std::ranges::any_of(
        others, [](const Finding& one) { return one.check == "camera_time" || one.check == "intrinsics"; });
    for (Finding& finding : of_silhouettes) {
        if (explained && (finding.check == "silhouette_residual" || finding.check == "camera_moved"))
            continue;
        if (finding.check == "silhouette_residual" && finding.verdict == Verdict::kNoGo &&
            certificate.hull_iou->mean_iou > kHardlyIntersect) {
            finding.verdict = Verdict::kCaution;
            finding.remedy =
                "check whether the silhouettes are complete (kinevox process --save silhouettes)";
        }
        certificate.findings.push_back(std::move(finding));
    }
    const auto known = [&](const Finding& one) {
        return std::ranges::any_of(certificate.findings, [&](const Finding& each) {
            return each.check == one.check && each.camera == one.camera;
        });
    };
    for (Finding& finding : others)
        if (!known(finding)) certificate.findings.push_back(std::move(finding));
}

absl::Status check(const SessionArguments& arguments) {
    if (absl::Status free = check_output(arguments.output, ".json"); !free.ok()) return free;
    const SolveProgress progress = console_progress(arguments.output.quiet);
    const auto seen = open(arguments, progress);
    if (!seen.ok()) return seen.status();
    Certificate certificate;
    certificate.method = "check";
    certificate.cameras = seen->cameras;
    certificate.hull_iou = hull_iou(seen->cameras, seen->set);
    arguments.output.print("silhouette residual {:.2f} px\n",
                           silhouette_residual_px(seen->cameras, seen->set));
    print_hull("check", *certificate.hull_iou, seen->cameras, arguments.output);
    auto findings = diagnose_silhouettes(seen->cameras, seen->set, {}, progress);
    if (!findings.ok()) return findings.status();
    const auto measured = measure_session(arguments.session, seen->cameras, progress);
    if (!measured.ok()) return measured.status();
    auto others = findings_of(*measured, seen->cameras, known_stature(arguments));
    add_findings(*std::move(findings), std::move(others), certificate);
    certificate.stature_m = measured->body.stature_m;
    certificate.world_defined = true;
    certificate.overlays = silhouette_overlays(seen->cameras, seen->set);
    arguments.output.print("{}", certificate_text(certificate));
    if (!arguments.output.file.empty())
        return write_certificate(certificate, arguments.output.file, arguments.output);
    if (arguments.output.json) fmt::print("{}", certificate_json(certificate));
    return absl::OkStatus();
}

CLI::App* declare(CLI::App& app, const char* name, const char* about, SessionArguments& arguments) {
    CLI::App* const verb = app.add_subcommand(name, about);
    verb->add_option("session", arguments.session, "Session (session.toml)")->required();
    verb->add_option("--calibration", arguments.calibration, "Calibration (default: the session's)");
    verb->add_option("--stature", arguments.stature_m, "Subject's height (m, with shoes); checks the scale")
        ->check(CLI::Range(0.5, 2.6));
    verb->add_option("--frame-sets", arguments.frame_sets, "Number of frame sets to use")
        ->check(CLI::Range(5, 500))
        ->capture_default_str();
    return verb;
}

}  // namespace

std::vector<Verb> session_verbs(CLI::App& app) {
    const auto refined = std::make_shared<SessionArguments>(), checked = std::make_shared<SessionArguments>();
    CLI::App* const refine_verb =
        declare(app, "refine", "Refine extrinsics from a moving person's silhouettes", *refined);
    declare_output(*refine_verb, refined->output);
    CLI::App* const check_verb =
        declare(app, "check", "Check a session's calibration (GO, CAUTION, NO-GO)", *checked);
    check_verb->add_option("--out", checked->output.file,
                           "Base name of the certificate (.json and .png are added)");
    check_verb->add_flag("--overwrite", checked->output.overwrite, "Replace an existing certificate");
    check_verb->add_flag("--json", checked->output.json, "Print the certificate as JSON");
    check_verb->add_flag("--quiet", checked->output.quiet, "Print no progress");
    return {{refine_verb, [refined] { return refine(*refined); }},
            {check_verb, [checked] { return check(*checked); }}};
}

}  // namespace kinevox::calibrate
