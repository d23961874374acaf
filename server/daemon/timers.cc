#include "server/daemon/timers.h"

#include <fmt/format.h>
#include <spdlog/spdlog.h>

#include <boost/asio/post.hpp>

#include "common/log_fields.h"
#include "common/utc_clock.h"

namespace kinevox {
namespace {

spdlog::level::level_enum log_level(EventLevel level) {
    switch (level) {
        case EventLevel::kError:
            return spdlog::level::err;
        case EventLevel::kWarning:
            return spdlog::level::warn;
        case EventLevel::kInfo:
            break;
    }
    return spdlog::level::info;
}

}  // namespace

StatusLog::StatusLog(boost::asio::io_context& io, const Runner& runner, StreamHub& hub)
    : runner_(runner), hub_(hub), timer_(io), events_(hub.events().subscribe(0, [] {})) {
    wait();
}

void StatusLog::wait() {
    timer_.expires_after(std::chrono::seconds(1));
    timer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        log_events();
        log_statistics();
        wait();
    });
}

void StatusLog::stop() {
    timer_.cancel();
    log_events();
}

void StatusLog::log_events() {
    constexpr int kMaxPerSecond = 5;
    int logged = 0, further = 0;
    while (const auto taken = events_->take()) {
        const Event& event = taken->message.event;
        further += static_cast<int>(taken->missed);
        const LogFields fields{{"KINEVOX_EVENT", std::string(event_name(event.kind))},
                               {"KINEVOX_CAMERA", event.camera},
                               {"KINEVOX_SEQUENCE", std::to_string(event.sequence)}};
        const EventLevel level = event_info(event.kind).level;
        if (level == EventLevel::kInfo && ++logged > kMaxPerSecond)
            ++further;
        else
            spdlog::log(log_level(level), "{}", event.message);
    }
    if (further > 0) spdlog::info("and {} further events; `kinevox events` shows them", further);
}

void StatusLog::log_statistics() {
    const RunSnapshot run = runner_.snapshot();
    if (run.result_count == logged_results_) return;
    logged_results_ = run.result_count;
    double litres = 0;
    if (const auto latest = hub_.latest())
        for (const SubjectResult& subject : latest->result->subjects)
            if (subject.volume) litres += volume_litres(*subject.volume);
    const std::string volume = litres > 0 ? fmt::format("{:.1f} l", litres) : "no subject";
    const int subscribers = hub_.subscribers().total() - 1;  // this log follows the events, too
    const LogFields fields{{"KINEVOX_EVENT", "statistics"},
                           {"KINEVOX_SEQUENCE", std::to_string(run.latest_sequence)},
                           {"KINEVOX_RESULT_RATE_HZ", fmt::format("{:.1f}", run.result_rate_hz)},
                           {"KINEVOX_LOST", std::to_string(run.lost_count)},
                           {"KINEVOX_TOTAL_MS", fmt::format("{:.1f}", run.median.total_ms)},
                           {"KINEVOX_P99_MS", fmt::format("{:.1f}", run.total_p99_ms)},
                           {"KINEVOX_SUBSCRIBERS", std::to_string(subscribers)}};
    spdlog::info(
        "frame {} {:.1f}/s lost {} | seg {:.1f} track {:.1f} hull {:.1f} colour {:.1f} total {:.1f} p99 "
        "{:.1f} ms | {} | {} subscribers",
        run.latest_sequence, run.result_rate_hz, run.lost_count, run.median.segmentation_ms,
        run.median.tracking_ms, run.median.hull_ms, run.median.colouring_ms, run.median.total_ms,
        run.total_p99_ms, volume, subscribers);
}

RetentionTimer::RetentionTimer(boost::asio::io_context& io, boost::asio::any_io_executor files,
                               const RetentionLimits& limits, const Recorder& recorder, const Replay& replay,
                               EventLog& events)
    : files_(std::move(files)),
      limits_(limits),
      recorder_(recorder),
      replay_(replay),
      events_(events),
      timer_(io) {
    if (!recorder_.options().folder.empty()) apply();
}

void RetentionTimer::apply() {
    boost::asio::post(files_, [this] {
        const auto replayed = replay_.status();
        apply_retention(
            recorder_.options().folder, limits_, utc_now_ns(),
            replayed.open ? replayed.session_file : std::filesystem::path(),
            [this](const std::string& name, const absl::Status& deleted) {
                const LogFields fields{{"KINEVOX_EVENT", "recording_deleted"}, {"KINEVOX_RECORDING", name}};
                if (deleted.ok())
                    spdlog::info(
                        "recording \"{}\" deleted, by retention_days and max_total_gb of [recording]", name);
                else  // an event is logged, too
                    events_.publish(EventKind::kError, fmt::format("recording \"{}\" cannot be deleted: {}",
                                                                   name, std::string(deleted.message())));
            });
    });
    timer_.expires_after(std::chrono::minutes(10));
    timer_.async_wait([this](const boost::system::error_code& error) {
        if (!error) apply();
    });
}

void RetentionTimer::stop() {
    timer_.cancel();
}

LeaseTimer::LeaseTimer(boost::asio::io_context& io, ControlLease& lease, EventLog& events)
    : io_(io), lease_(lease), events_(events), timer_(io) {
    lease_.set_on_change([this] { boost::asio::post(io_, [this] { rearm(); }); });
}

void LeaseTimer::rearm() {
    if (stopped_) return;
    const auto holder = lease_.holder();
    if (!holder) {
        timer_.cancel();
        return;
    }
    timer_.expires_after(holder->remaining);
    timer_.async_wait([this](const boost::system::error_code& error) {
        if (error) return;
        if (const auto operator_name = lease_.take_expired())
            events_.publish(EventKind::kControlReleased,
                            fmt::format("the lease of '{}' has expired", *operator_name));
        else
            rearm();
    });
}

void LeaseTimer::stop() {
    stopped_ = true;
    timer_.cancel();
}

}  // namespace kinevox
