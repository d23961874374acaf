#include "client/viewer/commands.h"

#include <fmt/format.h>

#include <utility>

#include "common/proto_time.h"

namespace kinevox::viewer {
namespace {

constexpr std::chrono::seconds kLongCall{60};  // learning the background, closing a recording

std::string summary(const v1::Recording& r) {
    std::string text = fmt::format("recording \"{}\" saved: {:.1f} s, {} frame sets", r.name(),
                                   to_seconds(r.duration()), r.frame_set_count());
    if (r.dropped_frame_set_count() > 0) text += fmt::format(", {} dropped", r.dropped_frame_set_count());
    if (!r.end_reason().empty()) text += "; " + r.end_reason();
    return text;
}

}  // namespace

Commands::Commands(client::ClientOptions options) : options_(std::move(options)) {
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

Commands::~Commands() = default;

bool Commands::enqueue(const QString& name, std::function<absl::Status(client::Client&, std::string&)> act) {
    const std::scoped_lock lock(mutex_);
    if (pending_.size() >= kMaxPending) return false;
    pending_.push_back({name, std::move(act)});
    idle_since_.reset();
    changed_.notify_all();
    return true;
}

void Commands::run(const std::stop_token& stop) {
    client::Client client(options_);
    for (;;) {
        Command command;
        {
            std::unique_lock lock(mutex_);
            if (!changed_.wait(lock, stop, [this] { return !pending_.empty(); }) || stop.stop_requested())
                return;
            command = std::move(pending_.front());
            pending_.pop_front();
        }
        emit started(command.name);
        std::string message;
        const absl::Status status = command.act(client, message);
        {
            const std::scoped_lock lock(mutex_);
            if (pending_.empty()) idle_since_ = std::chrono::steady_clock::now();
        }
        if (status.ok())
            emit done(QString::fromStdString(message));
        else
            emit failed(command.name + ": " + QString::fromStdString(std::string(status.message())));
    }
}

std::optional<std::chrono::steady_clock::time_point> Commands::idle_since() const {
    const std::scoped_lock lock(mutex_);
    return idle_since_;
}

bool Commands::start_capture() {
    return enqueue(tr("Start"), [](client::Client& c, std::string& done) {
        done = "capture started";
        return c.start(kOperatorName);
    });
}

bool Commands::stop_capture() {
    return enqueue(tr("Stop"), [](client::Client& c, std::string& done) {
        done = "capture stopped";
        return c.stop(kOperatorName);
    });
}

bool Commands::learn_background(int frame_set_count) {
    return enqueue(tr("Learn background"), [frame_set_count](client::Client& c, std::string& done) {
        done = "background learned";
        return c.learn_background(kOperatorName, frame_set_count, kLongCall);
    });
}

bool Commands::start_recording() {
    return enqueue(tr("Record"), [](client::Client& c, std::string& done) {
        const auto response = c.start_recording(kOperatorName, {});
        if (response.ok()) done = "recording \"" + response->name() + "\"";
        return response.status();
    });
}

bool Commands::stop_recording() {
    return enqueue(tr("Stop recording"), [](client::Client& c, std::string& done) {
        const auto response = c.stop_recording(kOperatorName, kLongCall);
        if (response.ok()) done = summary(response->recording());
        return response.status();
    });
}

bool Commands::save_buffer() {
    return enqueue(tr("Save buffer"), [](client::Client& c, std::string& done) {
        const auto response = c.save_buffer(kOperatorName, {}, kLongCall);
        if (response.ok()) done = summary(response->recording());
        return response.status();
    });
}

bool Commands::list_recordings() {
    return enqueue(tr("List recordings"), [this](client::Client& c, std::string&) {
        const auto response = c.list_recordings();
        if (!response.ok()) return response.status();
        QStringList names, labels;
        for (const v1::Recording& r : response->recordings()) {
            names.prepend(QString::fromStdString(r.name()));
            labels.prepend(QString::fromStdString(fmt::format(
                "{}   {:.1f} s{}", r.name(), to_seconds(r.duration()), r.has_poses() ? "" : ", no poses")));
        }
        emit recordings_received(names, labels);
        return absl::OkStatus();
    });
}

bool Commands::open_replay(const std::string& recording_name) {
    return enqueue(tr("Replay"), [recording_name](client::Client& c, std::string& done) {
        v1::OpenReplayRequest request;
        request.set_recording_name(recording_name);
        request.set_loop(true);
        done = "replay of \"" + recording_name + "\"";
        return c.open_replay(kOperatorName, std::move(request)).status();
    });
}

bool Commands::close_replay() {
    return enqueue(tr("Return to cameras"), [](client::Client& c, std::string& done) {
        done = "live cameras";
        return c.close_replay(kOperatorName);
    });
}

bool Commands::play(bool on) {
    return enqueue(on ? tr("Play") : tr("Pause"), [on](client::Client& c, std::string&) {
        v1::UpdateReplayRequest request;
        request.set_playing(on);
        return c.update_replay(kOperatorName, std::move(request)).status();
    });
}

bool Commands::step(int frames) {
    return enqueue(tr("Step"), [frames](client::Client& c, std::string&) {
        v1::UpdateReplayRequest request;
        request.set_step_frames(frames);
        return c.update_replay(kOperatorName, std::move(request)).status();
    });
}

bool Commands::seek(std::int64_t frame) {
    return enqueue(tr("Seek"), [frame](client::Client& c, std::string&) {
        v1::UpdateReplayRequest request;
        request.set_frame(frame);
        return c.update_replay(kOperatorName, std::move(request)).status();
    });
}

bool Commands::set_speed(double speed) {
    return enqueue(tr("Speed"), [speed](client::Client& c, std::string&) {
        v1::UpdateReplayRequest request;
        request.set_speed(speed);
        return c.update_replay(kOperatorName, std::move(request)).status();
    });
}

bool Commands::set_loop(bool on) {
    return enqueue(tr("Loop"), [on](client::Client& c, std::string&) {
        v1::UpdateReplayRequest request;
        request.set_loop(on);
        return c.update_replay(kOperatorName, std::move(request)).status();
    });
}

}  // namespace kinevox::viewer
