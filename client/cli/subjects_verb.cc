// `kinevox subjects`: the people in the scene, and who of them is followed.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>

#include "client/cli/output.h"
#include "client/cli/verbs.h"
#include "common/proto_time.h"

namespace kinevox::cli {
namespace {

struct SubjectsOptions {
    std::string operator_name = default_operator_name();
    std::vector<std::uint32_t> ids;
    std::uint32_t id = 0;
    std::string name;
    bool all = false;
};

std::string state_text(const v1::ListedSubject& subject) {
    std::string text = short_name(*v1::SubjectFollowing_descriptor()->FindValueByNumber(subject.following()));
    std::ranges::replace(text, '_', ' ');
    if (subject.has_absent_duration())
        text += fmt::format(" for {:.0f} s", to_seconds(subject.absent_duration()));
    return text;
}

std::string subjects_text(const v1::ListSubjectsResponse& response) {
    if (response.subjects().empty()) return "no subject";
    Table table({">id", "name", "state", ">x m", ">y m", ">height m"});
    for (const v1::ListedSubject& subject : response.subjects())
        table.add({fmt::format("{}", subject.subject_id()), subject.name().empty() ? "-" : subject.name(),
                   state_text(subject), fmt::format("{:.2f}", subject.centre_in_world().x()),
                   fmt::format("{:.2f}", subject.centre_in_world().y()),
                   fmt::format("{:.2f}", subject.height_m())});
    return table.text();
}

// The list after a change.
absl::Status show_list(const GlobalOptions& global) {
    return report<v1::ListSubjectsResponse>(global, client::Client(global.client_options()).list_subjects(),
                                            subjects_text);
}

absl::Status run_list(const GlobalOptions& global, const SubjectsOptions&) {
    return show_list(global);
}

absl::Status select(const GlobalOptions& global, const SubjectsOptions& options,
                    const v1::SelectSubjectsRequest& request, const std::string& done) {
    const absl::Status selected =
        client::Client(global.client_options()).select_subjects(options.operator_name, request);
    if (selected.ok()) print_line(global.json ? nlohmann::ordered_json({{"done", done}}).dump() : done);
    return selected;
}

absl::Status run_follow(const GlobalOptions& global, const SubjectsOptions& options) {
    v1::SelectSubjectsRequest request;
    request.set_follow_all(options.all);
    if (!options.all && options.ids.empty())
        return absl::InvalidArgumentError("no subject is given; give the ids to follow, or --all");
    request.mutable_followed_ids()->Assign(options.ids.begin(), options.ids.end());
    return select(global, options, request, options.all ? "follows as configured" : "follows only these");
}

absl::Status run_ignore(const GlobalOptions& global, const SubjectsOptions& options) {
    v1::SelectSubjectsRequest request;
    request.mutable_ignored_ids()->Assign(options.ids.begin(), options.ids.end());
    return select(global, options, request, "ignored");
}

absl::Status run_name(const GlobalOptions& global, const SubjectsOptions& options) {
    v1::NameSubjectRequest request;
    request.set_subject_id(options.id);
    request.set_name(options.name);
    const absl::Status named =
        client::Client(global.client_options()).name_subject(options.operator_name, request);
    const char* const done = options.name.empty() ? "name removed" : "named";
    if (named.ok()) print_line(global.json ? nlohmann::ordered_json({{"done", done}}).dump() : done);
    return named;
}

}  // namespace

void add_subjects_verb(CLI::App& app, GlobalOptions& global, Run& run) {
    const auto options = std::make_shared<SubjectsOptions>();
    CLI::App* subjects = app.add_subcommand("subjects", "List people, and choose who is followed");
    subjects->require_subcommand(1);
    add_action(*subjects, global, run, options, "list",
               "List the people in the scene, and those who may return", run_list);
    CLI::App* follow = add_action(*subjects, global, run, options, "follow",
                                  "Follow only these subjects (acquires control)", run_follow);
    CLI::Option* const ids = follow->add_option("ids", options->ids, "Subject ids");
    follow->add_flag("--all", options->all, "Follow whom the configuration selects")->excludes(ids);
    CLI::App* ignore = add_action(*subjects, global, run, options, "ignore",
                                  "Do not follow these subjects (acquires control)", run_ignore);
    ignore->add_option("ids", options->ids, "Subject ids")->required();
    CLI::App* name =
        add_action(*subjects, global, run, options, "name", "Name a subject (acquires control)", run_name);
    name->add_option("id", options->id, "Subject id")->required();
    name->add_option("name", options->name, "Name; empty removes it")->required();
    for (CLI::App* const changing : {follow, ignore, name})
        add_operator_option(*changing, options->operator_name);
}

}  // namespace kinevox::cli
