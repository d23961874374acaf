// What needs a recorded session with a person in it: refine and check.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <memory>
#include <string>

#include "server/calibration/diagnosis.h"
#include "server/calibration/hull_agreement.h"
#include "server/calibration/person_refine.h"
#include "server/calibration/session_silhouettes.h"
#include "server/tools/calibrate/certificate_files.h"
#include "server/tools/calibrate/console.h"
#include "server/tools/calibrate/verbs.h"

namespace kinevox::calibrate {
namespace {

struct SessionArguments {
    std::string session, calibration, out;
    double height_m = 0;
    int moments = 60;
    bool quiet = false;
};

absl::StatusOr<SessionSilhouettes> open(const SessionArguments& arguments, const SolveProgress& progress) {
    return session_silhouettes(arguments.session, arguments.moments, arguments.calibration, progress);
}

std::optional<double> known_height(const SessionArguments& arguments) {
    return arguments.height_m > 0 ? std::optional<double>(arguments.height_m) : std::nullopt;
}

void print_hull(const char* what, const HullAgreement& hull, const std::vector<Camera>& cameras) {
    fmt::print("{}: hull and silhouettes agree to {:.4f} (IoU, {} frames):", what, hull.mean_iou,
               hull.frames);
    for (std::size_t c = 0; c < cameras.size(); ++c) fmt::print(" {} {:.3f}", cameras[c].name, hull.iou[c]);
    fmt::print("\n");
}

absl::Status refine(const SessionArguments& arguments) {
    const SolveProgress progress = console_progress(arguments.quiet);
    const auto seen = open(arguments, progress);
    if (!seen.ok()) return seen.status();
    const auto refined =
        refine_from_person(seen->cameras, seen->set, arguments.moments, known_height(arguments), progress);
    if (!refined.ok()) return refined.status();
    const Certificate& certificate = refined->certificate;
    print_hull("before", *certificate.hull_before, seen->cameras);
    if (const auto& better = refined->better) {
        print_hull("after ", *certificate.hull, seen->cameras);
        fmt::print("outlines miss by {:.2f} px, before {:.2f}\n", better->miss_after_px,
                   better->miss_before_px);
        for (std::size_t c = 0; c < seen->cameras.size(); ++c)
            fmt::print("{:12} turned by {:.2f} degrees, moved by {:.0f} mm\n", seen->cameras[c].name,
                       better->turned_deg[c], 1000 * better->moved_m[c]);
    }
    return write_calibration(certificate, arguments.out);
}

absl::Status check(const SessionArguments& arguments) {
    const SolveProgress progress = console_progress(arguments.quiet);
    const auto seen = open(arguments, progress);
    if (!seen.ok()) return seen.status();
    Certificate certificate;
    certificate.made_by = "check";
    certificate.cameras = seen->cameras;
    certificate.hull = hull_agreement(seen->cameras, seen->set);
    fmt::print("outlines miss by {:.2f} px\n", silhouette_miss_px(seen->cameras, seen->set));
    print_hull("check", *certificate.hull, seen->cameras);
    auto findings = diagnose_silhouettes(seen->cameras, seen->set, {}, progress);
    if (!findings.ok()) return findings.status();
    certificate.findings = *std::move(findings);
    judge_by_person(seen->set, known_height(arguments), certificate);
    fmt::print("{}", certificate_text(certificate));
    return arguments.out.empty() ? absl::OkStatus() : write_certificate(certificate, arguments.out);
}

CLI::App* declare(CLI::App& app, const char* name, const char* about, SessionArguments& arguments) {
    CLI::App* const verb = app.add_subcommand(name, about);
    verb->add_option("session", arguments.session, "The session's file, session.toml")->required();
    verb->add_option("--calibration", arguments.calibration, "Instead of the session's own");
    verb->add_option("--subject-height", arguments.height_m, "m, as measured: checks the scale")
        ->check(CLI::Range(0.5, 2.6));
    verb->add_option("--moments", arguments.moments, "Frame sets to look at")
        ->check(CLI::Range(5, 500))
        ->capture_default_str();
    verb->add_flag("--quiet", arguments.quiet, "No progress");
    return verb;
}

}  // namespace

std::vector<Verb> session_verbs(CLI::App& app) {
    const auto refined = std::make_shared<SessionArguments>(), checked = std::make_shared<SessionArguments>();
    CLI::App* const refine_verb = declare(
        app, "refine", "Better places of the cameras from the silhouettes of a person who moves", *refined);
    refine_verb
        ->add_option("--out", refined->out, "The calibration to write, .toml; its certificate goes beside it")
        ->required();
    CLI::App* const check_verb =
        declare(app, "check", "Whether a session's calibration can be trusted: GO, CARE or NO-GO", *checked);
    check_verb->add_option("--out", checked->out, "Write the certificate to this name with .json added");
    return {{refine_verb, [refined] { return refine(*refined); }},
            {check_verb, [checked] { return check(*checked); }}};
}

}  // namespace kinevox::calibrate
