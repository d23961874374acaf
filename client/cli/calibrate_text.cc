#include <fmt/format.h>
#include <unistd.h>

#include <cstdio>

#include "client/cli/output.h"
#include "client/cli/verbs.h"
#include "client/lib/guided_calibration.h"

namespace kinevox::cli {
namespace {

constexpr std::chrono::seconds kHintInterval{2};

// "cam1 12 (34 %)": accepted views, and how much of the image they cover.
std::string cameras_text(const v1::WatchProcedureResponse& progress) {
    std::string out;
    for (const v1::CameraObservations& camera : progress.cameras())
        out += fmt::format("{}{} {} ({:.0f} %)", out.empty() ? "" : ", ", camera.name(),
                           camera.accepted_count(), 100 * camera.coverage());
    return out;
}

std::string state_text(const v1::WatchProcedureResponse& progress) {
    const std::string state =
        short_name(*v1::ProcedureState_descriptor()->FindValueByNumber(progress.state()));
    if (progress.state() == v1::PROCEDURE_STATE_COLLECTING && !progress.hints().empty())
        return "next: " + progress.hints(0);
    if (progress.state() == v1::PROCEDURE_STATE_COLLECTING && progress.sufficient())
        return "coverage suffices";
    if (progress.state() == v1::PROCEDURE_STATE_READING_FILES ||
        progress.state() == v1::PROCEDURE_STATE_SOLVING)
        return state;
    return progress.message().empty() ? state : progress.message();
}

std::string optional_px(bool has, double value) {
    return has ? fmt::format("{:.3f}", value) : "-";
}

}  // namespace

std::string certificate_text(const v1::Certificate& certificate) {
    std::string out = client::verdict_text(certificate.verdict(), "-") + "\n";
    for (const v1::CertificateFinding& finding : certificate.findings()) {
        if (finding.verdict() == v1::VERDICT_GO) continue;
        out += fmt::format("  {}: {}\n", client::verdict_text(finding.verdict(), "-"),
                           client::finding_line(finding));
    }
    if (certificate.has_held_out_reprojection_rms_px())
        out += fmt::format("held-out reprojection error {:.3f} px\n",
                           certificate.held_out_reprojection_rms_px());
    if (certificate.has_scale_bias_mm_per_m())
        out += fmt::format("scale {:+.2f} mm/m, spread {:.2f} mm/m\n", certificate.scale_bias_mm_per_m(),
                           certificate.scale_spread_mm_per_m());
    if (certificate.has_hull_iou())
        out += fmt::format("hull IoU {:.3f}{}\n", certificate.hull_iou(),
                           certificate.has_hull_iou_before()
                               ? fmt::format(", before {:.3f}", certificate.hull_iou_before())
                               : "");
    Table table({"camera", ">views", ">fit px", ">held-out px", ">coverage", ">x m", ">y m", ">z m"});
    for (const v1::CameraCertificate& camera : certificate.cameras()) {
        const v1::Vec3& centre = camera.centre_in_world();
        table.add(
            {camera.name(), fmt::to_string(camera.view_count()),
             camera.has_intrinsics_rms_px()
                 ? optional_px(true, camera.intrinsics_rms_px())
                 : optional_px(camera.has_fit_reprojection_rms_px(), camera.fit_reprojection_rms_px()),
             optional_px(camera.has_held_out_reprojection_rms_px(), camera.held_out_reprojection_rms_px()),
             camera.has_coverage() ? fmt::format("{:.0f} %", 100 * camera.coverage()) : "-",
             fmt::format("{:.3f}", centre.x()), fmt::format("{:.3f}", centre.y()),
             fmt::format("{:.3f}", centre.z())});
    }
    return out + table.text();
}

bool ProcedureText::print(const v1::WatchProcedureResponse& progress) {
    const bool draws = isatty(STDERR_FILENO);
    if (draws) fmt::print(stderr, "\r\033[K");
    const std::string line = state_text(progress);
    const auto now = std::chrono::steady_clock::now();
    const bool collecting = progress.state() == v1::PROCEDURE_STATE_COLLECTING;
    if (line != last_ && (!collecting || now - printed_ >= kHintInterval)) {
        last_ = line;
        printed_ = now;
        if (!print_line(line)) return false;
    }
    if (draws && client::is_open(progress)) {
        if (collecting)
            fmt::print(stderr, "{} shared frame sets; {}", progress.shared_frame_set_count(),
                       cameras_text(progress));
        else
            fmt::print(stderr, "{:3.0f} %  {}", 100 * progress.progress(), progress.message());
        std::fflush(stderr);
    }
    return true;
}

}  // namespace kinevox::cli
