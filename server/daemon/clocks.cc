#include "server/daemon/clocks.h"

#include <absl/strings/ascii.h>
#include <absl/strings/strip.h>
#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <boost/asio/post.hpp>

#include "common/log_fields.h"
#include "server/api/to_proto.h"
#include "server/pipeline/utc_clock.h"

namespace kinevox {
namespace {

// "camera_lost", as in the API.
std::string event_word(EventKind kind) {
    const std::string name = v1::EventKind_Name(to_proto(kind));
    return absl::AsciiStrToLower(absl::StripPrefix(name, "EVENT_KIND_"));
}

// Somebody has to do something, or a recording will lack what is lost meanwhile.
spdlog::level::level_enum level_of(EventKind kind) {
    switch (kind) {
        case EventKind::kError:
        case EventKind::kRecordingFailed:
            return spdlog::level::err;
        case EventKind::kCameraLost:
        case EventKind::kCameraLosses:
        case EventKind::kCameraMoved:
        case EventKind::kRecordingDrops:
            return spdlog::level::warn;
        default:
            return spdlog::level::info;
    }
}

}  // namespace

StatusLog::StatusLog(boost::asio::io_context& io, const Runner& runner, StreamHub& hub)
    : runner_(runner), hub_(hub), timer_(io), events_(hub.subscribe_events(0, [] {})) {
    wait();
}

void StatusLog::wait() {
    timer_.expires_after(std::chrono::seconds(1));
    timer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        log_events();
        log_figures();
        wait();
    });
}

void StatusLog::stop() {
    timer_.cancel();
    log_events();
}

void StatusLog::log_events() {
    constexpr int kMost = 5;
    int logged = 0, further = 0;
    while (const auto taken = events_->take()) {
        const Event& event = taken->message.event;
        further += static_cast<int>(taken->missed);
        const LogFields fields{{"KINEVOX_EVENT", event_word(event.kind)},
                               {"KINEVOX_CAMERA", event.camera},
                               {"KINEVOX_SEQUENCE", std::to_string(event.sequence)}};
        const auto level = level_of(event.kind);
        if (level == spdlog::level::info && ++logged > kMost)
            ++further;
        else
            spdlog::log(level, "{}", event.message);
    }
    if (further > 0) spdlog::info("and {} further events; `kinevox events` shows them", further);
}

void StatusLog::log_figures() {
    const RunFigures figures = runner_.figures();
    if (figures.results == logged_results_) return;
    logged_results_ = figures.results;
    std::string volume = "nobody is tracked";
    if (const auto newest = hub_.newest(); newest && newest->result->volume)
        volume = fmt::format("{:.1f} l", volume_litres(*newest->result->volume));
    const StreamHub::Subscribers subscribers = hub_.subscribers();
    const LogFields fields{
        {"KINEVOX_EVENT", "figures"},
        {"KINEVOX_SEQUENCE", std::to_string(figures.newest_sequence)},
        {"KINEVOX_RATE", fmt::format("{:.1f}", figures.results_per_second)},
        {"KINEVOX_LOST", std::to_string(figures.lost)},
        {"KINEVOX_TOTAL_MS", fmt::format("{:.1f}", figures.median.total_ms)},
        {"KINEVOX_P99_MS", fmt::format("{:.1f}", figures.total_p99_ms)},
        {"KINEVOX_SUBSCRIBERS", std::to_string(subscribers.volumes + subscribers.pictures)}};
    spdlog::info(
        "frame {} {:.1f}/s lost {} | seg {:.1f} track {:.1f} hull {:.1f} colour {:.1f} total {:.1f} p99 "
        "{:.1f} ms "
        "| {} | {} subscribers",
        figures.newest_sequence, figures.results_per_second, figures.lost, figures.median.segmentation_ms,
        figures.median.tracking_ms, figures.median.hull_ms, figures.median.colouring_ms,
        figures.median.total_ms, figures.total_p99_ms, volume, subscribers.volumes + subscribers.pictures);
}

RetentionClock::RetentionClock(boost::asio::io_context& io, boost::asio::any_io_executor files,
                               const RetentionLimits& limits, const Recorder& recorder, const Replay& replay,
                               StreamHub& hub)
    : files_(std::move(files)), limits_(limits), recorder_(recorder), replay_(replay), hub_(hub), timer_(io) {
    if (!recorder_.options().folder.empty()) look();
}

void RetentionClock::look() {
    boost::asio::post(files_, [this] {
        const auto replayed = replay_.status();
        apply_retention(
            recorder_.options().folder, limits_, utc_now_ns(),
            replayed.open ? replayed.session_file : std::filesystem::path(),
            [this](const std::string& name, const absl::Status& deleted) {
                const LogFields fields{{"KINEVOX_EVENT", "recording_deleted"}, {"KINEVOX_RECORDING", name}};
                if (deleted.ok())
                    spdlog::info("recording \"{}\" was deleted, as keep_days and keep_gb of [recording] say",
                                 name);
                else  // an event is logged, too
                    hub_.publish_event({EventKind::kError,
                                        0,
                                        0,
                                        {},
                                        fmt::format("recording \"{}\" should be deleted and cannot be: {}",
                                                    name, std::string(deleted.message()))},
                                       utc_now_ns());
            });
    });
    timer_.expires_after(std::chrono::minutes(10));
    timer_.async_wait([this](const boost::system::error_code& error) {
        if (!error) look();
    });
}

void RetentionClock::stop() {
    timer_.cancel();
}

LeaseClock::LeaseClock(boost::asio::io_context& io, ControlLease& lease, StreamHub& hub)
    : io_(io), lease_(lease), hub_(hub), timer_(io) {
    lease_.set_on_change([this] { boost::asio::post(io_, [this] { rearm(); }); });
}

void LeaseClock::rearm() {
    if (stopped_) return;
    const auto holder = lease_.holder();
    if (!holder) {
        timer_.cancel();
        return;
    }
    timer_.expires_after(holder->remaining);
    timer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        if (const auto name = lease_.take_expired())
            hub_.publish_event(
                {EventKind::kControlReleased, 0, 0, {}, fmt::format("the lease of '{}' has run out", *name)},
                utc_now_ns());
        else
            rearm();
    });
}

void LeaseClock::stop() {
    stopped_ = true;
    timer_.cancel();
}

}  // namespace kinevox
