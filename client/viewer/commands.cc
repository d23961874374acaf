#include "client/viewer/commands.h"

#include <fmt/format.h>

#include <utility>

namespace kinevox::viewer {
namespace {

constexpr std::chrono::seconds kLongWork{60};  // learning, closing a recording

std::string summary(const v1::Recording& r) {
    std::string text =
        fmt::format("\"{}\" is recorded: {:.1f} s, {} frame sets", r.name(), r.seconds(), r.frames());
    if (r.dropped() > 0) text += fmt::format(", {} not recorded", r.dropped());
    if (!r.end_reason().empty()) text += "; " + r.end_reason();
    return text;
}

}  // namespace

Commands::Commands(client::ClientOptions options) : options_(std::move(options)) {
    thread_ = std::jthread([this](const std::stop_token& stop) { run(stop); });
}

Commands::~Commands() = default;

bool Commands::ask(const QString& what, std::function<absl::Status(client::Client&, std::string&)> act) {
    const std::scoped_lock lock(mutex_);
    if (asked_.size() >= kMaxWaiting) return false;
    asked_.push_back({what, std::move(act)});
    idle_since_.reset();
    changed_.notify_all();
    return true;
}

void Commands::run(const std::stop_token& stop) {
    client::Client client(options_);
    for (;;) {
        Asked asked;
        {
            std::unique_lock lock(mutex_);
            if (!changed_.wait(lock, stop, [this] { return !asked_.empty(); }) || stop.stop_requested())
                return;
            asked = std::move(asked_.front());
            asked_.pop_front();
        }
        emit begun(asked.what);
        std::string message;
        const absl::Status status = asked.act(client, message);
        {
            const std::scoped_lock lock(mutex_);
            if (asked_.empty()) idle_since_ = std::chrono::steady_clock::now();
        }
        if (status.ok())
            emit done(QString::fromStdString(message));
        else
            emit failed(asked.what + ": " + QString::fromStdString(std::string(status.message())));
    }
}

std::optional<std::chrono::steady_clock::time_point> Commands::idle_since() const {
    const std::scoped_lock lock(mutex_);
    return idle_since_;
}

bool Commands::start_capture() {
    return ask(tr("Start"), [](client::Client& c, std::string& done) {
        done = "the capture runs";
        return c.start(kOperator);
    });
}

bool Commands::stop_capture() {
    return ask(tr("Stop"), [](client::Client& c, std::string& done) {
        done = "the capture is stopped";
        return c.stop(kOperator);
    });
}

bool Commands::learn_background(int frames) {
    return ask(tr("Learn the empty scene"), [frames](client::Client& c, std::string& done) {
        done = "the empty scene is learned";
        return c.learn_background(kOperator, frames, kLongWork);
    });
}

bool Commands::start_recording() {
    return ask(tr("Record"), [](client::Client& c, std::string& done) {
        const auto answer = c.start_recording(kOperator, {});
        if (answer.ok()) done = "recording \"" + answer->name() + "\"";
        return answer.status();
    });
}

bool Commands::stop_recording() {
    return ask(tr("Stop recording"), [](client::Client& c, std::string& done) {
        const auto answer = c.stop_recording(kOperator, kLongWork);
        if (answer.ok()) done = summary(answer->recording());
        return answer.status();
    });
}

bool Commands::keep_last() {
    return ask(tr("Keep what just happened"), [](client::Client& c, std::string& done) {
        const auto answer = c.keep_last(kOperator, {}, kLongWork);
        if (answer.ok()) done = summary(answer->recording());
        return answer.status();
    });
}

bool Commands::list_recordings() {
    return ask(tr("Recordings"), [this](client::Client& c, std::string&) {
        const auto answer = c.list_recordings();
        if (!answer.ok()) return answer.status();
        QStringList names, texts;
        for (const v1::Recording& r : answer->recordings()) {
            names.prepend(QString::fromStdString(r.name()));
            texts.prepend(QString::fromStdString(
                fmt::format("{}   {:.1f} s{}", r.name(), r.seconds(), r.has_poses() ? "" : ", no poses")));
        }
        emit recordings_came(names, texts);
        return absl::OkStatus();
    });
}

bool Commands::open_replay(const std::string& recording) {
    return ask(tr("Replay"), [recording](client::Client& c, std::string& done) {
        v1::OpenReplayRequest request;
        request.set_session(recording);
        request.set_loop(true);
        done = "replaying \"" + recording + "\"";
        return c.open_replay(kOperator, std::move(request)).status();
    });
}

bool Commands::close_replay() {
    return ask(tr("Back to the cameras"), [](client::Client& c, std::string& done) {
        done = "back to the cameras";
        return c.close_replay(kOperator);
    });
}

bool Commands::play(bool on) {
    return ask(on ? tr("Play") : tr("Pause"), [on](client::Client& c, std::string&) {
        v1::SetReplayRequest request;
        request.set_play(on);
        return c.set_replay(kOperator, std::move(request)).status();
    });
}

bool Commands::step(int frames) {
    return ask(tr("Step"), [frames](client::Client& c, std::string&) {
        v1::SetReplayRequest request;
        request.set_step(frames);
        return c.set_replay(kOperator, std::move(request)).status();
    });
}

bool Commands::seek(std::int64_t frame) {
    return ask(tr("Seek"), [frame](client::Client& c, std::string&) {
        v1::SetReplayRequest request;
        request.set_frame(frame);
        return c.set_replay(kOperator, std::move(request)).status();
    });
}

bool Commands::set_speed(double speed) {
    return ask(tr("Speed"), [speed](client::Client& c, std::string&) {
        v1::SetReplayRequest request;
        request.set_speed(speed);
        return c.set_replay(kOperator, std::move(request)).status();
    });
}

bool Commands::set_loop(bool on) {
    return ask(tr("Loop"), [on](client::Client& c, std::string&) {
        v1::SetReplayRequest request;
        request.set_loop(on);
        return c.set_replay(kOperator, std::move(request)).status();
    });
}

}  // namespace kinevox::viewer
