// `kinevox body`: the size of the person that the daemon measures.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>

#include "client/cli/action.h"
#include "client/cli/json.h"
#include "client/cli/verbs.h"

namespace kinevox::cli {
namespace {

struct BodyOptions {
    std::string name = default_operator_name();
    double seconds = 0;
};

std::string progress_text(const v1::WatchBodyResponse& progress) {
    std::string out = short_name(*v1::BodyFitState_descriptor()->FindValueByNumber(progress.state()));
    if (progress.state() == v1::BODY_FIT_STATE_COLLECTING || progress.state() == v1::BODY_FIT_STATE_FITTING)
        out += fmt::format(" {:.0f} %", 100 * progress.part());
    return progress.message().empty() ? out : out + ": " + progress.message();
}

std::string measure_text(const v1::BodyMeasure& measure, const char* what) {
    std::string out = fmt::format("{:<8}{:<22}{:7.1f} cm", what, measure.name(), 100 * measure.value_m());
    return measure.has_std_m() ? out + fmt::format("  +- {:.1f}", 100 * measure.std_m()) : out;
}

void print_body(const v1::Body& body) {
    print_line(measure_text(body.stature(), ""));
    for (const v1::BodyMeasure& length : body.lengths()) print_line(measure_text(length, "length"));
    for (const v1::BodyMeasure& girth : body.girths()) print_line(measure_text(girth, "girth"));
}

absl::Status run_show(const Common& common, const BodyOptions&) {
    client::StreamOptions stream;
    stream.max_silence = common.client_options().timeout;
    return client::Client(common.client_options())
        .watch_body(
            [&](const v1::WatchBodyResponse& progress) {
                if (common.json) return print_line(to_json(progress).dump()), false;
                print_line(progress_text(progress));
                print_body(progress.body());
                return false;
            },
            stream);
}

absl::Status run_fit(const Common& common, const BodyOptions& options) {
    constexpr std::chrono::seconds kMaxSilence{
        90};  // while nobody steps in, or other work leaves no processor
    client::Client client(common.client_options());
    v1::FitBodyRequest request;
    request.set_seconds(options.seconds);
    if (absl::Status begun = client.fit_body(options.name, request); !begun.ok()) return begun;
    client::StreamOptions stream;
    stream.stop = stop_on_signals();
    stream.max_silence = std::max<std::chrono::milliseconds>(kMaxSilence, common.client_options().timeout);
    absl::Status failed;
    const absl::Status status = client.watch_body(
        [&](const v1::WatchBodyResponse& progress) {
            const bool over =
                progress.state() == v1::BODY_FIT_STATE_READY || progress.state() == v1::BODY_FIT_STATE_FAILED;
            if (progress.state() == v1::BODY_FIT_STATE_FAILED)
                failed = absl::FailedPreconditionError(progress.message());
            const bool read = print_line(common.json ? to_json(progress).dump() : progress_text(progress));
            if (progress.state() == v1::BODY_FIT_STATE_READY && !common.json) print_body(progress.body());
            return read && !over;
        },
        stream);
    if (!failed.ok()) return failed;
    return absl::IsCancelled(status) ? absl::OkStatus() : status;
}

}  // namespace

void add_body_verb(CLI::App& app, Common& common, Run& run) {
    const auto options = std::make_shared<BodyOptions>();
    CLI::App* body = app.add_subcommand("body", "The size of the person that is measured");
    body->require_subcommand(1);
    const auto add = [&](const char* name, const char* help,
                         absl::Status (*act)(const Common&, const BodyOptions&)) {
        return add_action(*body, common, run, options, name, help, act);
    };
    add("show", "The body in use: lengths and girths, with their uncertainty where they were fitted",
        run_show);
    CLI::App* fit =
        add("fit", "Fit it to who stands in the space, at best in a T-pose (takes control for the moment)",
            run_fit);
    fit->add_option("--seconds", options->seconds, "Of pictures to fit it to, 1 to 30; 0: 4")
        ->check(CLI::Range(0.0, 30.0));
    fit->add_option("--name", options->name, "Under which name control is taken")->capture_default_str();
}

}  // namespace kinevox::cli
