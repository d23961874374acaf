#include "client/cli/status_text.h"

#include <fmt/format.h>

#include <cmath>

#include "client/cli/json.h"

namespace kinevox::cli {
namespace {

std::string state_name(const v1::GetStatusResponse& status) {
    return short_name(*v1::CaptureState_descriptor()->FindValueByNumber(status.state()));
}

std::string stage_table(const v1::GetStatusResponse& status) {
    std::string out = fmt::format("  {:<14}{:>10}{:>10}   ms\n", "stage", "newest", "median");
    const auto row = [&](const char* name, double newest, double median) {
        out += fmt::format("  {:<14}{:>10.2f}{:>10.2f}\n", name, newest, median);
    };
    const v1::StageTimes& newest = status.newest_times();
    const v1::StageTimes& median = status.median_times();
    row("decode", newest.decode_ms(), median.decode_ms());
    row("segmentation", newest.segmentation_ms(), median.segmentation_ms());
    row("tracking", newest.tracking_ms(), median.tracking_ms());
    row("hull", newest.hull_ms(), median.hull_ms());
    row("colouring", newest.colouring_ms(), median.colouring_ms());
    if (newest.pose_ms() > 0 || median.pose_ms() > 0) row("pose", newest.pose_ms(), median.pose_ms());
    row("total", newest.total_ms(), median.total_ms());
    return out + fmt::format("  {:<14}{:>10}{:>10.2f}\n", "total, p99", "", status.total_p99_ms());
}

// Of a live camera: what it lost and how well it keeps time, or why it is not there.
std::string link_text(const v1::CameraStatus& camera) {
    if (!camera.has_link()) return "";
    const v1::CameraLink& link = camera.link();
    if (!link.problem().empty()) return link.problem();
    return fmt::format("{} pictures, {} lost, {} in part, {} late; skew {:.1f} ms", link.pictures(),
                       link.lost(), link.incomplete(), link.late() + link.unmatched(), link.skew_ms());
}

std::string camera_table(const v1::GetStatusResponse& status) {
    std::string out;
    for (const v1::CameraStatus& camera : status.cameras()) {
        const std::string iou =
            std::isnan(camera.silhouette_iou()) ? "-" : fmt::format("{:.3f}", camera.silhouette_iou());
        const char* state = !camera.has_picture()   ? "no picture"
                            : !status.has_subject() ? ""
                            : camera.used()         ? "agrees"
                                                    : "left out";
        out += fmt::format("  {:<14}{:>10}   {:<10}   {}\n", camera.name(), iou, state, link_text(camera));
        while (out.ends_with(" \n")) out.erase(out.size() - 2, 1);
    }
    return out.empty() ? out : fmt::format("  {:<14}{:>10}\n", "camera", "IoU") + out;
}

}  // namespace

std::string status_text(const v1::GetStatusResponse& status) {
    std::string out =
        fmt::format("kinevoxd {}  {}  {}", status.version(), state_name(status), status.source());
    if (!status.state_message().empty()) out += fmt::format("\n  {}", status.state_message());
    out += fmt::format("\n  {:.1f} of {:g} frame sets/s   {} results   {} lost   up {} s\n",
                       status.results_per_second(), status.source_fps(), status.results(), status.lost(),
                       status.uptime_ms() / 1000);
    out += stage_table(status);
    if (status.has_volume())
        out += fmt::format("  volume        {:>10} voxels of {:g} mm, {:.1f} l\n", status.volume().voxels(),
                           status.volume().voxel_m() * 1000, status.volume().litres());
    if (status.has_subject()) {
        const v1::Vec3& centre = status.subject().centre_in_world();
        out += fmt::format("  subject {:<6}{:>10} {:.2f} {:.2f} {:.2f} m\n", status.subject().subject_id(),
                           "at", centre.x(), centre.y(), centre.z());
    } else {
        out += "  nobody is tracked\n";
    }
    out += camera_table(status);
    out += fmt::format("  subscribers   {} volumes, {} poses, {} previews, {} events",
                       status.volume_subscribers(), status.pose_subscribers(), status.preview_subscribers(),
                       status.event_subscribers());
    if (status.has_control())
        out += fmt::format("\n  control       {} for another {:.0f} s", status.control().holder(),
                           static_cast<double>(status.control().remaining_ms()) / 1000);
    return out;
}

std::string status_line(const v1::GetStatusResponse& status) {
    const v1::StageTimes& t = status.median_times();
    std::string out = fmt::format(
        "{} frame {} {:.1f}/s lost {} | seg {:.2f} track {:.2f} hull {:.2f} colour {:.2f} pose {:.2f} total "
        "{:.2f} "
        "p99 {:.2f} ms |",
        state_name(status), status.sequence(), status.results_per_second(), status.lost(),
        t.segmentation_ms(), t.tracking_ms(), t.hull_ms(), t.colouring_ms(), t.pose_ms(), t.total_ms(),
        status.total_p99_ms());
    if (status.has_volume())
        out += fmt::format(" {} voxels {:.1f} l", status.volume().voxels(), status.volume().litres());
    else
        out += " nobody is tracked";
    return out;
}

}  // namespace kinevox::cli
