// `kinevox body`: the subject's body model.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>

#include "client/cli/output.h"
#include "client/cli/verbs.h"
#include "common/proto_time.h"

namespace kinevox::cli {
namespace {

struct BodyOptions {
    std::string operator_name = default_operator_name();
    double duration_s = 0;
    std::uint32_t subject_id = 0;
};

std::string progress_text(const v1::SubjectBody& body) {
    std::string out = short_name(*v1::BodyFitState_descriptor()->FindValueByNumber(body.state()));
    if (body.subject_id() > 0) out = fmt::format("subject {}: {}", body.subject_id(), out);
    if (body.state() == v1::BODY_FIT_STATE_COLLECTING || body.state() == v1::BODY_FIT_STATE_FITTING)
        out += fmt::format(" {:.0f} %", 100 * body.progress());
    return body.message().empty() ? out : out + ": " + body.message();
}

std::string body_text(const v1::Body& body) {
    Table table({"kind", "name", ">cm", ">std"});
    const auto add = [&](const char* kind, const v1::BodyMeasurement& measurement) {
        table.add({kind, measurement.name(), fmt::format("{:.1f}", 100 * measurement.value_m()),
                   measurement.has_std_m() ? fmt::format("{:.1f}", 100 * measurement.std_m()) : "-"});
    };
    add("", body.stature());
    for (const v1::BodyMeasurement& length : body.lengths()) add("length", length);
    for (const v1::BodyMeasurement& girth : body.girths()) add("girth", girth);
    return table.text();
}

absl::Status run_show(const GlobalOptions& global, const BodyOptions&) {
    client::StreamOptions stream;
    stream.idle_timeout = global.client_options().timeout;
    return client::Client(global.client_options())
        .watch_body(
            [&](const v1::WatchBodyResponse& response) {
                if (global.json) return print_line(to_json(response).dump()), false;
                for (const v1::SubjectBody& subject : response.subjects()) {
                    print_line(progress_text(subject));
                    print_line(body_text(subject.body()));
                }
                return false;
            },
            stream);
}

// The body that is fitted: the requested one, or the only one.
const v1::SubjectBody* fitted_body(const v1::WatchBodyResponse& response, std::uint32_t subject_id) {
    for (const v1::SubjectBody& subject : response.subjects())
        if (subject_id == 0 || subject.subject_id() == subject_id) return &subject;
    return nullptr;
}

absl::Status run_fit(const GlobalOptions& global, const BodyOptions& options) {
    // While no subject is there, or other work occupies the processor.
    constexpr std::chrono::seconds kIdleTimeout{90};
    client::Client client(global.client_options());
    v1::FitBodyRequest request;
    request.set_subject_id(options.subject_id);
    if (options.duration_s != 0) *request.mutable_duration() = duration_from_s(options.duration_s);
    if (absl::Status begun = client.fit_body(options.operator_name, request); !begun.ok()) return begun;
    client::StreamOptions stream;
    stream.stop = stop_on_signals();
    stream.idle_timeout = std::max<std::chrono::milliseconds>(kIdleTimeout, global.client_options().timeout);
    absl::Status failed;
    const absl::Status status = client.watch_body(
        [&](const v1::WatchBodyResponse& response) {
            const v1::SubjectBody* const body = fitted_body(response, options.subject_id);
            if (!body) return true;
            const bool ready = body->state() == v1::BODY_FIT_STATE_READY;
            if (body->state() == v1::BODY_FIT_STATE_FAILED)
                failed = absl::FailedPreconditionError(body->message());
            const bool read = print_line(global.json ? to_json(response).dump() : progress_text(*body));
            if (ready && !global.json) print_line(body_text(body->body()));
            return read && !ready && failed.ok();
        },
        stream);
    if (!failed.ok()) return failed;
    return absl::IsCancelled(status) ? absl::OkStatus() : status;
}

}  // namespace

void add_body_verb(CLI::App& app, GlobalOptions& global, Run& run) {
    const auto options = std::make_shared<BodyOptions>();
    CLI::App* body = app.add_subcommand("body", "Show or fit the subject's body model");
    body->require_subcommand(1);
    add_action(*body, global, run, options, "show",
               "Show the active body: lengths and girths with their uncertainty", run_show);
    CLI::App* fit =
        add_action(*body, global, run, options, "fit",
                   "Fit the body model to the subject, ideally in a T-pose (acquires control)", run_fit);
    fit->add_option("--duration", options->duration_s, "Capture time to fit to (s, 1 to 30; default 4)")
        ->check(CLI::Range(0.0, 30.0));
    fit->add_option("--subject", options->subject_id, "Subject to fit (id; default: the only one)");
    add_operator_option(*fit, options->operator_name);
}

}  // namespace kinevox::cli
