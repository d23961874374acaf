#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <functional>
#include <utility>
#include <vector>

#include "client/viewer/feed.h"
#include "common/proto_time.h"

namespace kinevox::viewer {
namespace {

constexpr double kMaxIdle_s = 1.5, kMinRateFraction = 0.8;  // of the cameras' rate

std::string plural(std::size_t n, const std::string& one) {
    return fmt::format("{} {}{}", n, one, n == 1 ? "" : "s");
}

// Texts of the cameras' issues, the worst first.
std::vector<std::string> camera_issues(const v1::GetStatusResponse& status) {
    std::vector<CameraIssue> issues;
    for (const v1::CameraStatus& camera : status.cameras())
        if (CameraIssue issue = camera_issue(camera, status.subjects_size() > 0); issue.severity > 0)
            issues.push_back(std::move(issue));
    std::ranges::stable_sort(issues, std::greater(), &CameraIssue::severity);
    std::vector<std::string> texts;
    for (CameraIssue& issue : issues) texts.push_back(std::move(issue.text));
    return texts;
}

std::string state_text(const v1::GetStatusResponse& status, const v1::Replay* replay) {
    if (replayed(replay)) return replay->state() == v1::REPLAY_STATE_PAUSED ? "Replay, paused" : "Replay";
    switch (status.state()) {
        case v1::CAPTURE_STATE_RUNNING:
            return "Live";
        case v1::CAPTURE_STATE_LEARNING_BACKGROUND:
            return "Learning background";
        case v1::CAPTURE_STATE_STARTING:
            return "Starting";
        case v1::CAPTURE_STATE_SOURCE_ENDED:
            return "Ended";
        case v1::CAPTURE_STATE_FAILED:
            return "Failed";
        default:
            return "Stopped";
    }
}

bool is_running(const v1::GetStatusResponse& status) {
    return status.state() == v1::CAPTURE_STATE_RUNNING ||
           status.state() == v1::CAPTURE_STATE_LEARNING_BACKGROUND;
}

std::string subjects_text(const v1::GetStatusResponse& status) {
    if (status.subjects_size() == 0) return "no subject";
    std::vector<std::string> volumes;
    for (const v1::SubjectStatus& subject : status.subjects())
        volumes.push_back(fmt::format("{:.0f} litres", subject.volume().volume_litres()));
    return fmt::format("{}", fmt::join(volumes, ", "));
}

std::string status_line(const ConnectionStatus& connection, const v1::GetStatusResponse& status,
                        const v1::GetRecorderStatusResponse* recorder, bool live) {
    std::vector<std::string> items;
    if (is_running(status)) {
        items.push_back(fmt::format("{:.0f} frames per second", status.result_rate_hz()));
        if (live && connection.latency_ms)
            items.push_back(fmt::format("latency {:.0f} ms", *connection.latency_ms));
        std::size_t with_image = 0;
        for (const v1::CameraStatus& camera : status.cameras()) with_image += camera.has_image();
        if (const auto cameras = static_cast<std::size_t>(status.cameras_size()); cameras > 0)
            items.push_back((with_image == cameras ? "" : fmt::format("{} of ", with_image)) +
                            plural(cameras, "camera"));
        items.push_back(subjects_text(status));
        if (status.lost_frame_set_count() > 0)
            items.push_back(fmt::format("{} lost", status.lost_frame_set_count()));
    }
    if (recorder && recorder->has_current()) {
        const v1::Recording& recording = recorder->current();
        items.push_back(
            fmt::format("recording \"{}\" {:.0f} s", recording.name(), to_seconds(recording.duration())));
        if (recording.dropped_frame_set_count() > 0)
            items.push_back(fmt::format("{} dropped", recording.dropped_frame_set_count()));
    }
    return fmt::format("{}", fmt::join(items, "  ·  "));
}

}  // namespace

bool replayed(const v1::Replay* replay) {
    return replay && replay->state() != v1::REPLAY_STATE_LIVE &&
           replay->state() != v1::REPLAY_STATE_UNSPECIFIED;
}

CameraIssue camera_issue(const v1::CameraStatus& camera, bool tracked) {
    if (camera.has_connection() && !camera.connection().error_message().empty())
        return {"disconnected", fmt::format("{}: {}", camera.name(), camera.connection().error_message()), 3};
    if (!camera.has_image())
        return {
            "no image",
            fmt::format("{} delivers no image; check its cable and that it is not covered", camera.name()),
            3};
    if (camera.calibration_suspect())
        return {"moved", fmt::format("{}: {}", camera.name(), camera.calibration_suspect_reason()), 2};
    const auto used = [](const v1::CameraSubjectStatus& subject) { return subject.used(); };
    if (tracked && std::ranges::none_of(camera.subjects(), used))
        return {"excluded",
                fmt::format("{} is inconsistent with the other cameras and excluded", camera.name()), 1};
    return {};
}

StatusText describe_status(const ConnectionStatus& connection, const v1::GetStatusResponse* status,
                           const v1::GetRecorderStatusResponse* recorder, const v1::Replay* replay) {
    if (!connection.connected || !status)
        return {Severity::kError, connection.connected ? "Connecting" : "No connection", connection.server,
                connection.error_message.empty() ? "" : connection.error_message + "; reconnecting"};

    const bool running = is_running(*status), live = running && !replayed(replay);
    StatusText text;
    text.state = state_text(*status, replay);
    text.line = status_line(connection, *status, recorder, live);
    const std::vector<std::string> issues =
        running && status->result_count() > 0 ? camera_issues(*status) : std::vector<std::string>{};
    if (live && connection.idle_s > kMaxIdle_s) {
        text.severity = Severity::kError;
        text.state = "Stalled";
        text.remedy = fmt::format("no message from {} for {:.0f} s; check the network", connection.server,
                                  connection.idle_s);
    } else if (status->state() == v1::CAPTURE_STATE_FAILED) {
        text.severity = Severity::kError;
        text.remedy = status->state_message();
    } else if (!issues.empty()) {
        text.severity = Severity::kWarning;
        text.remedy = issues.front();
        if (issues.size() > 1) text.remedy += fmt::format(" (and {} more)", issues.size() - 1);
    } else if (live && status->state() == v1::CAPTURE_STATE_RUNNING && status->result_rate_hz() > 0 &&
               status->result_rate_hz() < kMinRateFraction * status->nominal_fps()) {
        text.severity = Severity::kWarning;
        text.remedy = fmt::format(
            "the daemon processes {:.0f} of {:.0f} frames per second; use larger voxels or close other "
            "programs on its machine",
            status->result_rate_hz(), status->nominal_fps());
    } else if (recorder && recorder->has_current() && recorder->current().dropped_frame_set_count() > 0) {
        text.severity = Severity::kWarning;
        text.remedy = "the recording drops frames; use a faster codec";
    } else if (!running) {
        text.severity = Severity::kWarning;
        text.remedy = status->state_message().empty() ? "press Start" : status->state_message();
    }
    return text;
}

}  // namespace kinevox::viewer
