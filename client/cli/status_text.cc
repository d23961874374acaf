#include <fmt/format.h>

#include "client/cli/output.h"

namespace kinevox::cli {
namespace {

std::string state_name(const v1::GetStatusResponse& status) {
    return short_name(*v1::CaptureState_descriptor()->FindValueByNumber(status.state()));
}

std::string stage_table(const v1::GetStatusResponse& status) {
    std::string out = fmt::format("  {:<14}{:>10}{:>10}   ms\n", "stage", "latest", "median");
    const auto row = [&](const char* name, double latest, double median) {
        out += fmt::format("  {:<14}{:>10.2f}{:>10.2f}\n", name, latest, median);
    };
    const v1::StageTimes& latest = status.latest_stage_times();
    const v1::StageTimes& median = status.median_stage_times();
    row("decode", latest.decode_ms(), median.decode_ms());
    row("segmentation", latest.segmentation_ms(), median.segmentation_ms());
    row("tracking", latest.tracking_ms(), median.tracking_ms());
    row("hull", latest.hull_ms(), median.hull_ms());
    row("colouring", latest.colouring_ms(), median.colouring_ms());
    if (latest.pose_ms() > 0 || median.pose_ms() > 0) row("pose", latest.pose_ms(), median.pose_ms());
    row("total", latest.total_ms(), median.total_ms());
    return out + fmt::format("  {:<14}{:>10}{:>10.2f}\n", "total, p99", "", status.total_p99_ms());
}

// Of a live camera: its losses and synchronisation, or why it is disconnected.
std::string connection_text(const v1::CameraStatus& camera) {
    if (!camera.has_connection()) return "";
    const v1::CameraConnection& connection = camera.connection();
    if (!connection.error_message().empty()) return connection.error_message();
    return fmt::format("{} images, {} lost, {} incomplete, {} late; skew {:.1f} ms", connection.image_count(),
                       connection.lost_image_count(), connection.incomplete_image_count(),
                       connection.late_image_count() + connection.unmatched_image_count(),
                       connection.mean_skew_ms());
}

// One row per camera and subject; one without a subject where none is tracked.
std::string camera_table(const v1::GetStatusResponse& status) {
    if (status.cameras().empty()) return "";
    Table table({"camera", ">subject", ">IoU", "use", "connection"});
    for (const v1::CameraStatus& camera : status.cameras()) {
        if (camera.subjects().empty() || !camera.has_image())
            table.add(
                {camera.name(), "", "-", camera.has_image() ? "" : "no image", connection_text(camera)});
        else
            for (const v1::CameraSubjectStatus& subject : camera.subjects())
                table.add(
                    {camera.name(), fmt::to_string(subject.subject_id()),
                     subject.has_silhouette_iou() ? fmt::format("{:.3f}", subject.silhouette_iou()) : "-",
                     subject.used() ? "used" : "excluded", connection_text(camera)});
    }
    return table.text();
}

// "2", or "2 Anna" with a name.
std::string label(const v1::Subject& subject) {
    return fmt::format("{}{}{}", subject.subject_id(), subject.name().empty() ? "" : " ", subject.name());
}

std::string subject_table(const v1::GetStatusResponse& status) {
    if (status.subjects().empty()) return "no subject";
    Table table({"subject", ">x m", ">y m", ">z m", ">voxels", ">mm", ">litres", "pose"});
    for (const v1::SubjectStatus& subject : status.subjects()) {
        const v1::Vec3& centre = subject.subject().centre_in_world();
        const bool volume = subject.has_volume();
        table.add({label(subject.subject()), fmt::format("{:.2f}", centre.x()),
                   fmt::format("{:.2f}", centre.y()), fmt::format("{:.2f}", centre.z()),
                   volume ? fmt::to_string(subject.volume().voxel_count()) : "-",
                   volume ? fmt::format("{:g}", subject.volume().voxel_m() * 1000) : "-",
                   volume ? fmt::format("{:.1f}", subject.volume().volume_litres()) : "-",
                   subject.pose_found() ? "found" : "none"});
    }
    return table.text();
}

// Each line further in.
std::string indented(const std::string& text) {
    std::string out = "  ";
    for (const char c : text) out += c == '\n' ? std::string("\n  ") : std::string(1, c);
    return out + "\n";
}

}  // namespace

namespace {

std::string quality_line(const v1::ResultQuality& quality) {
    const char* const trust = quality.trust() == v1::RESULT_TRUST_GOOD      ? "GOOD"
                              : quality.trust() == v1::RESULT_TRUST_CAUTION ? "CAUTION"
                                                                            : "DO NOT USE";
    std::string out = fmt::format("  quality: {}", trust);
    if (quality.has_posed_iou()) out += fmt::format(", posed body IoU {:.2f}", quality.posed_iou());
    if (quality.has_hull_iou()) out += fmt::format(", hull IoU {:.2f}", quality.hull_iou());
    if (!quality.cause().empty())
        out +=
            fmt::format("\n    {}: {}\n    remedy: {}", quality.cause(), quality.reason(), quality.remedy());
    return out + "\n";
}

}  // namespace

std::string status_text(const v1::GetStatusResponse& status) {
    std::string out =
        fmt::format("kinevoxd {}  {}  {}", status.version(), state_name(status), status.source());
    if (!status.state_message().empty()) out += fmt::format("\n  {}", status.state_message());
    out += fmt::format("\n  {:.1f} of {:g} frame sets/s   {}   {} lost   up {} s\n", status.result_rate_hz(),
                       status.nominal_fps(), count_of(status.result_count(), "result"),
                       status.lost_frame_set_count(), status.uptime().seconds());
    out += stage_table(status);
    out += indented(subject_table(status));
    if (const std::string cameras = camera_table(status); !cameras.empty()) out += indented(cameras);
    if (status.has_quality()) out += quality_line(status.quality());
    out += fmt::format("  subscribers: {} volumes, {} poses, {} previews, {} events",
                       status.volume_subscriber_count(), status.pose_subscriber_count(),
                       status.preview_subscriber_count(), status.event_subscriber_count());
    if (status.has_control_lease())
        out += fmt::format("\n  control: operator {}, {} s left", status.control_lease().operator_name(),
                           status.control_lease().remaining_duration().seconds());
    return out;
}

std::string status_line(const v1::GetStatusResponse& status) {
    const v1::StageTimes& t = status.median_stage_times();
    std::string out = fmt::format(
        "{} frame {} {:.1f}/s lost {} | seg {:.2f} track {:.2f} hull {:.2f} colour {:.2f} pose {:.2f} total "
        "{:.2f} p99 {:.2f} ms |",
        state_name(status), status.latest_sequence(), status.result_rate_hz(), status.lost_frame_set_count(),
        t.segmentation_ms(), t.tracking_ms(), t.hull_ms(), t.colouring_ms(), t.pose_ms(), t.total_ms(),
        status.total_p99_ms());
    if (status.subjects().empty()) return out + " no subject";
    for (const v1::SubjectStatus& subject : status.subjects())
        out += fmt::format(" subject {}: {} voxels {:.1f} l", label(subject.subject()),
                           subject.volume().voxel_count(), subject.volume().volume_litres());
    return out;
}

}  // namespace kinevox::cli
