#include "client/viewer/status_words.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <functional>
#include <utility>
#include <vector>

namespace kinevox::viewer {
namespace {

constexpr double kLongSilence_s = 1.5, kSlow = 0.8;  // of the cameras' rate

std::string plural(std::size_t n, const std::string& one) {
    return fmt::format("{} {}{}", n, one, n == 1 ? "" : "s");
}

// The cameras' troubles, the worst first.
std::vector<std::string> camera_troubles(const v1::GetStatusResponse& status) {
    std::vector<CameraTrouble> found;
    for (const v1::CameraStatus& camera : status.cameras())
        if (CameraTrouble trouble = camera_trouble(camera, status.has_subject()); trouble.gravity > 0)
            found.push_back(std::move(trouble));
    std::ranges::stable_sort(found, std::greater(), &CameraTrouble::gravity);
    std::vector<std::string> lines;
    for (CameraTrouble& trouble : found) lines.push_back(std::move(trouble.line));
    return lines;
}

std::string state_word(const v1::GetStatusResponse& status, const v1::Replay* replay) {
    if (replayed(replay)) return replay->state() == v1::REPLAY_STATE_PAUSED ? "Replay, paused" : "Replay";
    switch (status.state()) {
        case v1::CAPTURE_STATE_RUNNING:
            return "Live";
        case v1::CAPTURE_STATE_LEARNING:
            return "Learning the empty scene";
        case v1::CAPTURE_STATE_STARTING:
            return "Starting";
        case v1::CAPTURE_STATE_ENDED:
            return "Ended";
        case v1::CAPTURE_STATE_FAILED:
            return "Failed";
        default:
            return "Stopped";
    }
}

}  // namespace

bool replayed(const v1::Replay* replay) {
    return replay && replay->state() != v1::REPLAY_STATE_LIVE &&
           replay->state() != v1::REPLAY_STATE_UNSPECIFIED;
}

CameraTrouble camera_trouble(const v1::CameraStatus& camera, bool subject) {
    if (camera.has_link() && !camera.link().problem().empty())
        return {"not there", fmt::format("{}: {}", camera.name(), camera.link().problem()), 3};
    if (!camera.has_picture())
        return {"no picture",
                fmt::format("{} delivers no picture; see to its cable and its lens cap", camera.name()), 3};
    if (camera.calibration_suspect())
        return {"seems to have moved",
                fmt::format("{}: {}", camera.name(), camera.calibration_suspect_reason()), 2};
    if (subject && !camera.used())
        return {"disagrees", fmt::format("{} disagrees with the others and is left out", camera.name()), 1};
    return {};
}

Words in_words(const Link& link, const v1::GetStatusResponse* status,
               const v1::GetRecorderStatusResponse* recorder, const v1::Replay* replay) {
    if (!link.connected || !status)
        return {Mood::kBad, link.connected ? "Connecting" : "No connection", link.server,
                link.problem.empty() ? "" : link.problem + "; trying again"};

    Words words;
    words.state = state_word(*status, replay);
    const bool runs =
        status->state() == v1::CAPTURE_STATE_RUNNING || status->state() == v1::CAPTURE_STATE_LEARNING;
    const bool live = runs && !replayed(replay);
    std::vector<std::string> parts;
    if (runs) parts.push_back(fmt::format("{:.0f} pictures a second", status->results_per_second()));
    if (live && link.delay_ms) parts.push_back(fmt::format("{:.0f} ms behind", *link.delay_ms));
    std::size_t seeing = 0;
    for (const v1::CameraStatus& camera : status->cameras()) seeing += camera.has_picture();
    if (const auto cameras = static_cast<std::size_t>(status->cameras_size()); runs && cameras > 0)
        parts.push_back((seeing == cameras ? "" : fmt::format("{} of ", seeing)) + plural(cameras, "camera"));
    if (runs)
        parts.push_back(status->has_subject() ? fmt::format("{:.0f} litres", status->volume().litres())
                                              : "nobody in sight");
    if (runs && status->lost() > 0) parts.push_back(fmt::format("{} dropped", status->lost()));
    if (recorder && recorder->has_recording()) {
        const v1::Recording& recording = recorder->recording();
        parts.push_back(fmt::format("recording \"{}\" {:.0f} s", recording.name(), recording.seconds()));
        if (recording.dropped() > 0) parts.push_back(fmt::format("{} not recorded", recording.dropped()));
    }
    words.line = fmt::format("{}", fmt::join(parts, "  ·  "));

    const std::vector<std::string> troubles =
        runs && status->results() > 0 ? camera_troubles(*status) : std::vector<std::string>{};
    if (live && link.silent_s > kLongSilence_s) {
        words.mood = Mood::kBad;
        words.state = "Stalled";
        words.remedy = fmt::format("nothing has come from {} for {:.0f} s; see to the network between",
                                   link.server, link.silent_s);
    } else if (status->state() == v1::CAPTURE_STATE_FAILED) {
        words.mood = Mood::kBad;
        words.remedy = status->state_message();
    } else if (!troubles.empty()) {
        words.mood = Mood::kCare;
        words.remedy = troubles.front();
        if (troubles.size() > 1) words.remedy += fmt::format(" (and {} more)", troubles.size() - 1);
    } else if (live && status->state() == v1::CAPTURE_STATE_RUNNING && status->results_per_second() > 0 &&
               status->results_per_second() < kSlow * status->source_fps()) {
        words.mood = Mood::kCare;
        words.remedy = fmt::format(
            "the daemon's machine manages {:.0f} of {:.0f} pictures a second; larger voxels or fewer "
            "programs beside it help",
            status->results_per_second(), status->source_fps());
    } else if (recorder && recorder->has_recording() && recorder->recording().dropped() > 0) {
        words.mood = Mood::kCare;
        words.remedy = "not everything gets into the recording; a faster codec helps";
    } else if (!runs) {
        words.mood = Mood::kCare;
        words.remedy = status->state_message().empty() ? "press Start" : status->state_message();
    }
    return words;
}

}  // namespace kinevox::viewer
