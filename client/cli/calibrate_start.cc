// `kinevox calibrate start`: a procedure from its start to a stored calibration, guided.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <filesystem>

#include "client/cli/output.h"
#include "client/cli/verbs.h"
#include "client/lib/guided_calibration.h"

namespace kinevox::cli {
namespace {

using client::CalibrationStep;

struct StartOptions {
    std::string operator_name = default_operator_name();
    std::string kind, board, wand, intrinsics, note, session;
    std::vector<std::string> cameras, videos;
    int stride = 1, board_on_floor_frame = -1;
    double duration_s = 0, stature_m = 0;
    bool board_on_floor = false, refine_intrinsics = false, k3 = false, apply = false, restart = false;

    bool live() const { return videos.empty() && session.empty(); }
};

v1::StartProcedureRequest procedure_of(const StartOptions& options) {
    v1::StartProcedureRequest request;
    request.set_kind(options.kind == "intrinsics" ? v1::PROCEDURE_KIND_INTRINSICS
                     : options.kind == "refine"   ? v1::PROCEDURE_KIND_EXTRINSICS_REFINE_PERSON
                     : options.wand.empty()       ? v1::PROCEDURE_KIND_EXTRINSICS_BOARD
                                                  : v1::PROCEDURE_KIND_EXTRINSICS_WAND);
    *request.mutable_cameras() = {options.cameras.begin(), options.cameras.end()};
    request.set_board(options.board);
    request.set_wand(options.wand);
    request.set_intrinsics_calibration_id(options.intrinsics);
    request.set_refine_intrinsics(options.refine_intrinsics);
    request.set_estimate_k3(options.k3);
    request.set_stature_m(options.stature_m);
    request.set_note(options.note);
    return request;
}

std::string absolute_path(const std::string& path) {
    return std::filesystem::absolute(path).lexically_normal().string();
}

absl::StatusOr<v1::FileObservations> files_of(const StartOptions& options) {
    v1::FileObservations files;
    for (const std::string& text : options.videos) {
        const std::size_t equals = text.find('=');
        if (equals == std::string::npos)
            return absl::InvalidArgumentError(
                fmt::format("VIDEOS has '{}'; write NAME=FILE with the camera's name", text));
        v1::CameraClip& clip = *files.add_clips();
        clip.set_camera(text.substr(0, equals));
        clip.set_path(absolute_path(text.substr(equals + 1)));
    }
    if (!options.session.empty()) files.set_session_path(absolute_path(options.session));
    files.set_stride(options.stride);
    if (options.board_on_floor_frame >= 0) files.set_board_on_floor_frame(options.board_on_floor_frame);
    return files;
}

// What the operator does in a step; empty: nothing.
std::string instruction(CalibrationStep step, const StartOptions& options) {
    const std::string until = options.duration_s > 0 ? fmt::format("for {:g} s", options.duration_s)
                                                     : std::string("until coverage suffices");
    switch (step) {
        case CalibrationStep::kEmptyScene:
            return "leave the scene empty";
        case CalibrationStep::kBoardOnFloor:
            return "lay the board on the floor, print up, fully visible to at least two cameras";
        case CalibrationStep::kMovingTarget:
            return options.kind == "refine" ? "walk through the whole space " + until
                   : options.wand.empty()
                       ? "move the board through the space and hold it still at each position, " + until
                       : "wave the wand through the whole space " + until;
        default:
            return "";
    }
}

absl::Status show_result(client::Client& client, const StartOptions& options, const std::string& id) {
    v1::GetCertificateRequest wanted;
    wanted.set_calibration_id(id);
    const auto certificate = client.get_certificate(wanted);
    if (!certificate.ok()) return certificate.status();
    print_line(certificate_text(certificate->certificate()));
    if (!options.apply)
        print_line(fmt::format("stored as {0}; apply it with kinevox calibrate apply {0} --restart", id));
    return absl::OkStatus();
}

absl::Status apply(const GlobalOptions& global, client::Client& client,
                   client::GuidedCalibration& calibration, const StartOptions& options,
                   const std::string& id) {
    return calibration.with_control([&](const client::Lease& lease) {
        v1::ApplyCalibrationRequest request;
        request.set_lease_id(lease.id);
        request.set_calibration_id(id);
        request.set_restart_capture(options.restart);
        const auto applied = client.apply_calibration(request);
        if (!applied.ok()) return applied.status();
        print_line(global.json         ? to_json(*applied).dump()
                   : applied->active() ? id + " is active"
                                       : id + " is pending: active from the next start of the capture");
        return absl::OkStatus();
    });
}

absl::Status run_start(const GlobalOptions& global, const StartOptions& options) {
    const std::stop_token stopped = stop_on_signals();
    client::Client client(global.client_options());
    client::CalibrationPlan plan;
    plan.procedure = procedure_of(options);
    plan.board_on_floor = options.board_on_floor;
    plan.moving_duration = std::chrono::milliseconds(static_cast<std::int64_t>(options.duration_s * 1000));
    plan.hold_control = true;
    if (!options.live()) {
        auto files = files_of(options);
        if (!files.ok()) return files.status();
        plan.files = *std::move(files);
    }
    ProcedureText text;
    client::CalibrationObserver observer;
    observer.on_step = [&](CalibrationStep step) {
        if (const std::string line = instruction(step, options); !line.empty() && !global.json)
            print_line(line);
    };
    observer.on_progress = [&](const v1::WatchProcedureResponse& progress) {
        return global.json ? print_line(to_json(progress).dump()) : text.print(progress);
    };
    client::GuidedCalibration calibration(std::move(plan), std::move(observer));
    const std::stop_callback stop(stopped, [&] { calibration.stop(); });
    const auto id = calibration.run(client, options.operator_name);
    if (!id.ok()) return id.status();
    if (!global.json)
        if (absl::Status shown = show_result(client, options, *id); !shown.ok()) return shown;
    return options.apply ? apply(global, client, calibration, options, *id) : absl::OkStatus();
}

}  // namespace

void add_start_verb(CLI::App& calibrate, GlobalOptions& global, Run& run) {
    const auto options = std::make_shared<StartOptions>();
    CLI::App* start = add_action(
        calibrate, global, run, options, "start",
        "Run a guided calibration with live cameras or files on the server (holds control)", run_start);
    start->add_option("KIND", options->kind, "intrinsics, extrinsics or refine")
        ->required()
        ->check(CLI::IsMember({"intrinsics", "extrinsics", "refine"}));
    start->add_option("VIDEOS", options->videos,
                      "NAME=FILE per camera, on the server (default: the live cameras)");
    start->add_option(
        "--board", options->board,
        "checkerboard:4x7:60 (inner corners, mm), charuco:4x5:54:40.5:DICT_4X4_1000[:inverted] (squares, "
        "square mm, marker mm) or aprilgrid:6x6:88:26.4 (tags, tag mm, gap mm)");
    start->add_option("--wand", options->wand,
                      "Wand instead of a board: wand:200:600 (mm from the first ball)");
    start->add_option("--camera", options->cameras, "Camera to calibrate; repeatable (default: all)")
        ->allow_extra_args(false);
    start->add_option("--intrinsics", options->intrinsics,
                      "Calibration that supplies the intrinsics (default: the active one)");
    start->add_flag("--refine-intrinsics", options->refine_intrinsics,
                    "Refine the intrinsics together with the extrinsics");
    start->add_flag("--k3", options->k3, "Estimate a third radial distortion coefficient (very wide lenses)");
    start->add_flag("--board-on-floor", options->board_on_floor,
                    "First capture the board on the floor to define the world frame");
    start
        ->add_option("--board-on-floor-frame", options->board_on_floor_frame,
                     "With files: frame in which the board lies on the floor")
        ->check(CLI::NonNegativeNumber);
    start->add_option("--stride", options->stride, "With files: use every Nth image")
        ->check(CLI::Range(1, 100000));
    start->add_option("--session", options->session, "refine: session.toml on the server");
    start
        ->add_option("--stature", options->stature_m,
                     "refine: subject's height (m, with shoes); checks the scale")
        ->check(CLI::Range(0.5, 2.6));
    start
        ->add_option("--duration", options->duration_s,
                     "Collection time (s; default: until coverage suffices)")
        ->check(CLI::PositiveNumber);
    start->add_option("--note", options->note, "Note stored with the calibration");
    start->add_flag("--apply", options->apply, "Apply the result unless it is NO-GO");
    start->add_flag("--restart", options->restart, "Restart the capture so that it takes effect now");
    add_operator_option(*start, options->operator_name);
}

}  // namespace kinevox::cli
