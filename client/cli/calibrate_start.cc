// `kinevox calibrate start`: a procedure from its start to a stored calibration, guided.
#include <fmt/format.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <condition_variable>
#include <filesystem>
#include <mutex>
#include <thread>

#include "client/cli/calibrate_text.h"
#include "client/cli/calibrate_verb.h"
#include "client/cli/json.h"

namespace kinevox::cli {
namespace {

struct StartOptions {
    std::string name = default_operator_name();
    std::string what, board, wand, lenses, note, session;
    std::vector<std::string> cameras, clips;
    int every = 1, floor_frame = -1;
    double seconds = 0, subject_height_m = 0;
    bool floor = false, refine_lenses = false, k3 = false, apply = false, restart = false;
};

constexpr std::chrono::seconds kLease{30}, kRenewal{8};
constexpr std::chrono::minutes kMaxSilence{
    10};  // some steps of a solve on a busy machine have nothing to tell

// Control for as long as it lives.
class HeldControl {
  public:
    HeldControl(const client::ClientOptions& options, std::string lease_id)
        : client_(options), lease_id_(std::move(lease_id)), renewal_([this](const std::stop_token& stop) {
              std::unique_lock lock(mutex_);
              while (!stopped_.wait_for(lock, stop, kRenewal, [] { return false; }) && !stop.stop_requested())
                  client_.renew_control(lease_id_).IgnoreError();  // the next call says what is wrong
          }) {}
    ~HeldControl() {
        renewal_.request_stop();
        renewal_.join();
        client_.release_control(lease_id_).IgnoreError();
    }

  private:
    client::Client client_;
    std::string lease_id_;
    std::mutex mutex_;
    std::condition_variable_any stopped_;
    std::jthread renewal_;
};

class Guide {
  public:
    Guide(const Common& common, const StartOptions& options)
        : common_(common), options_(options), client_(common.client_options()), stop_(stop_on_signals()) {}

    absl::Status run() {
        v1::AcquireControlRequest control;
        control.set_name(options_.name);
        control.set_timeout_ms(std::chrono::milliseconds(kLease).count());
        const auto lease = client_.acquire_control(control);
        if (!lease.ok()) return lease.status();
        lease_id_ = lease->lease_id();
        const HeldControl held(common_.client_options(), lease_id_);
        if (absl::Status started = start(); !started.ok()) return started;
        absl::Status done = observe();
        if (done.ok()) done = solve();
        if (!done.ok()) {
            v1::CancelProcedureRequest cancel;
            cancel.set_lease_id(lease_id_);
            client_.cancel_procedure(cancel).status().IgnoreError();
            return absl::IsCancelled(done) ? absl::CancelledError("stopped; nothing was stored") : done;
        }
        return options_.apply ? apply() : absl::OkStatus();
    }

  private:
    using Progress = v1::WatchProcedureResponse;

    absl::Status start() {
        v1::StartProcedureRequest request;
        request.set_lease_id(lease_id_);
        request.set_kind(options_.what == "intrinsics" ? v1::PROCEDURE_KIND_INTRINSICS
                         : options_.what == "refine"   ? v1::PROCEDURE_KIND_REFINE_PERSON
                         : options_.wand.empty()       ? v1::PROCEDURE_KIND_EXTRINSICS_BOARD
                                                       : v1::PROCEDURE_KIND_EXTRINSICS_WAND);
        *request.mutable_cameras() = {options_.cameras.begin(), options_.cameras.end()};
        request.set_board(options_.board);
        request.set_wand(options_.wand);
        request.set_lenses_from(options_.lenses);
        request.set_refine_lenses(options_.refine_lenses);
        request.set_k3(options_.k3);
        request.set_subject_height_m(options_.subject_height_m);
        request.set_note(options_.note);
        return client_.start_procedure(request).status();
    }

    // Shows progress until `so`. Cancelled by Ctrl-C; an end by somebody else is an error. `limit` ends it,
    // too.
    absl::StatusOr<Progress> watch(const std::function<bool(const Progress&)>& so) {
        Progress last;
        client::StreamOptions stream;
        stream.stop = stop_;
        stream.max_silence = kMaxSilence;
        bool reached = false;
        const absl::Status status = client_.watch_procedure(
            [&](const Progress& progress) {
                last = progress;
                const bool read = common_.json ? print_line(to_json(progress).dump()) : text_.print(progress);
                reached = so(progress);
                return read && !reached && is_open(progress);
            },
            stream);
        if (!status.ok()) return status;
        if (!reached)
            return absl::AbortedError(last.message().empty() ? "nobody reads any more" : last.message());
        return last;
    }

    absl::Status take(v1::LiveObservations::What what) {
        v1::AddObservationsRequest request;
        request.set_lease_id(lease_id_);
        request.mutable_live()->set_what(what);
        return client_.add_observations(request).status();
    }

    void say(const std::string& text) {
        if (!common_.json) print_line(text);
    }

    absl::Status observe() {
        if (!options_.clips.empty() || !options_.session.empty()) return observe_files();
        if (!options_.wand.empty()) {
            say("leave the space empty for a moment");
            if (absl::Status taken = take(v1::LiveObservations::WHAT_EMPTY_SCENE); !taken.ok()) return taken;
            if (const auto seen = watch([](const Progress& p) { return !p.live(); }); !seen.ok())
                return seen.status();
        }
        if (options_.floor) {
            say("lay the board on the floor, print up, where two cameras see all of it");
            if (absl::Status taken = take(v1::LiveObservations::WHAT_BOARD_ON_FLOOR); !taken.ok())
                return taken;
            if (const auto seen = watch([](const Progress& p) { return p.floor_seen() && !p.live(); });
                !seen.ok())
                return seen.status();
        }
        const std::string until = options_.seconds > 0 ? fmt::format("{:g} s long", options_.seconds)
                                                       : std::string("until enough is seen");
        say(options_.what == "refine" ? "walk through the whole space, " + until
            : options_.wand.empty()   ? "move the board through the space, still at each place, " + until
                                      : "wave the wand through the whole space, " + until);
        if (absl::Status taken = take(v1::LiveObservations::WHAT_MOVING); !taken.ok()) return taken;
        const auto begun = std::chrono::steady_clock::now();
        return watch([&](const Progress& progress) {
                   const std::chrono::duration<double> since = std::chrono::steady_clock::now() - begun;
                   return options_.seconds > 0 ? since.count() >= options_.seconds || !progress.live()
                                               : progress.complete() || !progress.live();
               })
            .status();
    }

    absl::Status observe_files() {
        v1::AddObservationsRequest request;
        request.set_lease_id(lease_id_);
        v1::FileObservations& files = *request.mutable_files();
        for (const std::string& text : options_.clips) {
            const std::size_t equals = text.find('=');
            if (equals == std::string::npos)
                return absl::InvalidArgumentError(
                    fmt::format("'{}': write NAME=FILE with the camera's name", text));
            v1::CameraClip& clip = *files.add_clips();
            clip.set_camera(text.substr(0, equals));
            clip.set_file(std::filesystem::absolute(text.substr(equals + 1)).lexically_normal().string());
        }
        if (!options_.session.empty())
            files.set_session(std::filesystem::absolute(options_.session).lexically_normal().string());
        files.set_every(options_.every);
        if (options_.floor_frame >= 0) files.set_floor_frame(options_.floor_frame);
        if (absl::Status added = client_.add_observations(request).status(); !added.ok()) return added;
        const auto read =
            watch([](const Progress& p) { return p.state() == v1::PROCEDURE_STATE_COLLECTING; });
        if (!read.ok()) return read.status();
        if (read->message() != "the files are read") return absl::AbortedError(read->message());
        return absl::OkStatus();
    }

    absl::Status solve() {
        v1::SolveProcedureRequest request;
        request.set_lease_id(lease_id_);
        if (absl::Status begun = client_.solve_procedure(request).status(); !begun.ok()) return begun;
        const auto end = watch([](const Progress& p) { return p.state() != v1::PROCEDURE_STATE_SOLVING; });
        if (!end.ok()) return end.status();
        if (end->state() != v1::PROCEDURE_STATE_SOLVED) return absl::FailedPreconditionError(end->message());
        id_ = end->calibration_id();
        if (common_.json) return absl::OkStatus();
        v1::GetCertificateRequest wanted;
        wanted.set_id(id_);
        const auto certificate = client_.get_certificate(wanted);
        if (!certificate.ok()) return certificate.status();
        std::string text = certificate_text(certificate->certificate());
        text.pop_back();
        print_line(text);
        if (!options_.apply)
            print_line(fmt::format("stored as {0}; kinevox calibrate apply {0} --restart uses it", id_));
        return absl::OkStatus();
    }

    absl::Status apply() {
        v1::ApplyCalibrationRequest request;
        request.set_lease_id(lease_id_);
        request.set_id(id_);
        request.set_restart_capture(options_.restart);
        const auto applied = client_.apply_calibration(request);
        if (!applied.ok()) return applied.status();
        say(applied->in_use() ? id_ + " is in use" : id_ + " will be used from the capture's next start on");
        return absl::OkStatus();
    }

    const Common& common_;
    const StartOptions& options_;
    client::Client client_;
    std::stop_token stop_;
    std::string lease_id_, id_;
    ProcedureText text_;
};

}  // namespace

void add_start_verb(CLI::App& calibrate, Common& common, Run& run) {
    const auto options = std::make_shared<StartOptions>();
    CLI::App* start = calibrate.add_subcommand("start",
                                               "Calibrate with the daemon's live cameras, guided, or with "
                                               "files on its machine (holds control meanwhile)");
    add_common_options(*start, common);
    start->add_option("what", options->what, "intrinsics, extrinsics or refine")
        ->required()
        ->check(CLI::IsMember({"intrinsics", "extrinsics", "refine"}));
    start->add_option("clips", options->clips, "NAME=FILE for each camera, instead of the live cameras");
    start->add_option(
        "--board", options->board,
        "checkerboard:4x7:60 (inner corners, mm), charuco:4x5:54:40.5:DICT_4X4_1000[:inverted] (squares, "
        "square mm, marker mm) or aprilgrid:6x6:88:26.4 (tags, tag mm, gap mm)");
    start->add_option("--wand", options->wand,
                      "For extrinsics, instead of a board: wand:200:600, mm along it");
    start->add_option("--camera", options->cameras, "Only this one, and others so given; else all");
    start->add_option("--lenses", options->lenses,
                      "For extrinsics: the calibration whose lenses are taken; else the one in use");
    start->add_flag("--refine-lenses", options->refine_lenses,
                    "For extrinsics: let the lenses move a little");
    start->add_flag("--k3", options->k3, "For intrinsics: a third radial coefficient, for very wide lenses");
    start->add_flag("--floor", options->floor,
                    "For extrinsics: first the board lies on the floor and makes the world");
    start->add_option("--floor-frame", options->floor_frame, "With files: the picture in which it does")
        ->check(CLI::NonNegativeNumber);
    start->add_option("--every", options->every, "With files: every so many pictures only")
        ->check(CLI::Range(1, 100000));
    start->add_option("--session", options->session, "For refine: a session.toml on the daemon's machine");
    start->add_option("--subject-height", options->subject_height_m, "For refine: m, as measured")
        ->check(CLI::Range(0.5, 2.6));
    start->add_option("--seconds", options->seconds, "Look so long; else until enough is seen")
        ->check(CLI::PositiveNumber);
    start->add_option("--note", options->note, "Kept with the calibration");
    start->add_flag("--apply", options->apply, "Use it afterwards, unless it is NO-GO");
    start->add_flag("--restart", options->restart,
                    "With --apply: stop a capture that runs and start it anew with it");
    start->add_option("--name", options->name, "Under which name control is taken")->capture_default_str();
    start->callback(
        [&common, &run, options] { run = [&common, options] { return Guide(common, *options).run(); }; });
}

}  // namespace kinevox::cli
