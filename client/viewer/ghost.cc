#include "client/viewer/ghost.h"

#include <filesystem>
#include <utility>

#include "client/lib/client.h"
#include "client/viewer/feed.h"
#include "common/files.h"

namespace kinevox::viewer {
namespace {

constexpr std::chrono::seconds kExportIdleTimeout{60};
constexpr std::size_t kMaxBytes = 256 << 20;

absl::StatusOr<GhostTrial> read_recording(client::Client& client, const std::string& name) {
    v1::ExportRecordingRequest request;
    request.set_name(name);
    request.set_format(v1::EXPORT_FORMAT_CSV);
    std::string csv;
    client::StreamOptions options;
    options.idle_timeout = kExportIdleTimeout;
    const absl::Status status = client.export_recording(
        request,
        [&](const v1::ExportRecordingResponse& chunk) {
            csv += chunk.data();
            return csv.size() < kMaxBytes;
        },
        [](double) {}, options);
    if (!status.ok()) return status;
    return parse_ghost_trial(csv, name);
}

absl::StatusOr<GhostTrial> read_file_of(const std::string& file) {
    const auto csv = read_file(file, kMaxBytes);
    if (!csv.ok()) return csv.status();
    const std::filesystem::path path(file);
    // joints.csv is named by its folder.
    const std::string name =
        path.stem() == "joints" ? path.parent_path().filename().string() : path.stem().string();
    return parse_ghost_trial(*csv, name);
}

}  // namespace

Ghost::Ghost(const client::ClientOptions& options, GhostBar& bar) : bar_(bar), reading_(options) {
    connect(&bar_, &GhostBar::changed, this, [this] {
        match_.set_events(bar_.ghost_event(), bar_.shown_event());
        match_.set_offset_s(bar_.offset_s());
        match_.set_align_pelvis(bar_.align_pelvis());
        bar_.show_problem(match_.problem());
        emit changed();
    });
    connect(&bar_, &GhostBar::closed, this, &Ghost::clear);
    connect(this, &Ghost::trial_read, this, &Ghost::take, Qt::QueuedConnection);
    connect(&reading_, &Commands::failed, this,
            [this](const QString& message) { emit reported(message, false); });
}

void Ghost::choose(std::function<absl::StatusOr<GhostTrial>(client::Client&)> read, const QString& what,
                   bool ghost) {
    const bool accepted =
        reading_.enqueue(what, [this, ghost, read = std::move(read)](client::Client& client, std::string&) {
            auto trial = read(client);
            if (!trial.ok()) return trial.status();
            {
                const std::scoped_lock lock(mutex_);
                (ghost ? read_ghost_ : read_shown_) = std::make_shared<const GhostTrial>(*std::move(trial));
            }
            emit trial_read(ghost);
            return absl::OkStatus();
        });
    if (!accepted) emit reported(tr("too many pending commands; try again"), false);
}

void Ghost::choose_recording(const std::string& name) {
    pending_mark_s_.reset();
    choose([name](client::Client& client) { return read_recording(client, name); }, tr("Ghost"), true);
}

void Ghost::choose_file(const QString& file) {
    pending_mark_s_.reset();
    choose([name = file.toStdString()](client::Client&) { return read_file_of(name); }, tr("Ghost"), true);
}

void Ghost::choose_replayed() {
    if (replayed_.empty()) return emit reported(tr("no replay is open; open a recording first"), false);
    const auto mark_s = match_.shown_mark_s();
    const auto now_s = shown_ ? std::optional(shown_time_s(*shown_, replay_fps_)) : std::nullopt;
    const std::string name = replayed_;
    choose([name](client::Client& client) { return read_recording(client, name); }, tr("Ghost"), true);
    pending_mark_s_ = mark_s ? mark_s : now_s;
}

void Ghost::clear() {
    match_.set_ghost(nullptr);
    bar_.hide();
    emit changed();
}

void Ghost::take(bool ghost) {
    std::shared_ptr<const GhostTrial> trial;
    {
        const std::scoped_lock lock(mutex_);
        trial = std::exchange(ghost ? read_ghost_ : read_shown_, nullptr);
    }
    if (!trial) return;
    if (!ghost) {
        const auto mark_s = match_.shown_mark_s();  // set while it was read
        match_.set_shown(std::move(trial));
        if (mark_s) match_.mark_shown(*mark_s);
        bar_.show_problem(match_.problem());
        return emit changed();
    }
    match_.set_ghost(std::move(trial));
    const auto mark_s = std::exchange(pending_mark_s_, std::nullopt);
    if (mark_s) match_.mark_ghost(*mark_s);
    const bool live = replay_session_.empty();
    bar_.show_ghost(QString::fromStdString(match_.ghost()->name),
                    mark_s ? TrialEvent::kMark : TrialEvent::kBegin,
                    live || mark_s ? TrialEvent::kMark : TrialEvent::kBegin);
    read_replayed();
}

// The events of the replayed recording are found in its poses, if it has any.
void Ghost::read_replayed() {
    if (!match_.ghost() || replayed_.empty() || shown_recording_ == replayed_) return;
    shown_recording_ = replayed_;
    const std::string name = replayed_;
    choose([name](client::Client& client) { return read_recording(client, name); }, tr("Replayed recording"),
           false);
}

void Ghost::show_state(const DaemonState& state) {
    const bool open = replayed(state.replay.get());
    replay_fps_ = open ? state.replay->nominal_fps() : 0;
    const std::string session = open ? state.replay->session_path() : std::string();
    const std::filesystem::path file(session);
    const bool of_recorder =
        open && state.recorder && file.parent_path().parent_path() == state.recorder->folder();
    replayed_ = of_recorder ? file.parent_path().filename().string() : std::string();
    const bool was_live = replay_session_.empty();
    if (std::exchange(replay_session_, session) != session) {
        shown_recording_.clear();
        match_.set_shown(nullptr);
        if (match_.ghost() && was_live == open)
            bar_.set_shown_event(open ? TrialEvent::kBegin : TrialEvent::kMark);
        bar_.show_problem(match_.problem());
    }
    read_replayed();
}

std::shared_ptr<const ShownPose> Ghost::pose_for(std::shared_ptr<const ShownPose> shown) {
    shown_ = std::move(shown);
    return pose();
}

std::shared_ptr<const ShownPose> Ghost::pose() const {
    if (!shown_ || !match_.ghost()) return std::make_shared<const ShownPose>();
    return std::make_shared<const ShownPose>(match_.pose(*shown_, shown_time_s(*shown_, replay_fps_)));
}

void Ghost::mark() {
    if (!shown_) return;
    match_.mark_shown(shown_time_s(*shown_, replay_fps_));
    bar_.show_problem(match_.problem());
    emit changed();
}

}  // namespace kinevox::viewer
