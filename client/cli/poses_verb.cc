// `kinevox poses`: the daemon's pose database.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>

#include "client/cli/output.h"
#include "client/cli/verbs.h"
#include "common/files.h"
#include "common/progress_line.h"
#include "common/proto_time.h"

namespace kinevox::cli {
namespace {

struct PosesOptions {
    std::string operator_name = default_operator_name();
    std::string label, file;
    std::vector<std::string> coordinates;  // NAME=DEGREES
    double interval_s = 0;
    std::uint32_t subject_id = 0;
    bool user_only = false, follow = false, yes = false;
};

absl::Status run_list(const GlobalOptions& global, const PosesOptions& options) {
    auto response = client::Client(global.client_options()).list_library_poses();
    if (response.ok() && options.user_only) {
        auto& poses = *response->mutable_poses();
        poses.erase(
            std::remove_if(poses.begin(), poses.end(), [](const auto& pose) { return !pose.user_defined(); }),
            poses.end());
    }
    return report<v1::ListLibraryPosesResponse>(global, response, [](const auto& list) {
        Table table({"kind", "label"});
        for (const v1::LibraryPose& pose : list.poses())
            table.add({pose.user_defined() ? "user" : "library", pose.label()});
        return table.text();
    });
}

absl::Status run_add(const GlobalOptions& global, const PosesOptions& options) {
    v1::AddLibraryPoseRequest request;
    request.set_label(options.label);
    request.set_subject_id(options.subject_id);
    for (const std::string& text : options.coordinates) {
        const std::size_t equals = text.find('=');
        double degrees = 0;
        if (equals == std::string::npos || !CLI::detail::lexical_cast(text.substr(equals + 1), degrees))
            return absl::InvalidArgumentError(
                fmt::format("--coordinate is '{}'; write NAME=DEGREES, for example knee_angle_l=90", text));
        (*request.mutable_coordinates_deg())[text.substr(0, equals)] = degrees;
    }
    return report<v1::AddLibraryPoseResponse>(
        global, client::Client(global.client_options()).add_library_pose(options.operator_name, request),
        [](const auto& response) { return fmt::format("added; {} entries", response.entry_count()); });
}

absl::Status run_delete(const GlobalOptions& global, const PosesOptions& options) {
    if (absl::Status confirmed = confirm_deletion(options.yes, "all poses with the label " + options.label);
        !confirmed.ok())
        return confirmed;
    v1::DeleteLibraryPoseRequest request;
    request.set_label(options.label);
    return report<v1::DeleteLibraryPoseResponse>(
        global, client::Client(global.client_options()).delete_library_pose(options.operator_name, request),
        [](const auto& response) { return fmt::format("deleted; {} entries", response.entry_count()); });
}

absl::Status run_import(const GlobalOptions& global, const PosesOptions& options) {
    auto text = read_file(options.file, 32 << 20);
    if (!text.ok()) return text.status();
    v1::ImportLibraryPosesRequest request;
    request.set_label(options.label.empty() ? std::filesystem::path(options.file).stem().string()
                                            : options.label);
    request.set_data(*std::move(text));
    if (options.interval_s != 0) *request.mutable_interval() = duration_from_s(options.interval_s);
    ProgressLine line(global.json);
    line.draw("rendering the poses ...");
    const auto response = client::Client(global.client_options())
                              .import_library_poses(options.operator_name, std::move(request));
    line.clear();
    return report<v1::ImportLibraryPosesResponse>(global, response, [](const auto& imported) {
        return fmt::format("{} added; {} entries",
                           count_of(static_cast<std::uint64_t>(imported.pose_count()), "pose"),
                           imported.entry_count());
    });
}

std::string progress_text(const v1::WatchPoseDatabaseResponse& progress) {
    std::string out = short_name(*v1::PoseDatabaseState_descriptor()->FindValueByNumber(progress.state()));
    if (progress.state() == v1::POSE_DATABASE_STATE_BUILDING)
        out += fmt::format(" {:.0f} %", 100 * progress.progress());
    if (progress.entry_count() > 0) out += fmt::format(", {} entries", progress.entry_count());
    return progress.message().empty() ? out : out + ": " + progress.message();
}

// Until the database is built.
absl::Status run_watch(const GlobalOptions& global, const PosesOptions& options) {
    client::StreamOptions stream;
    stream.stop = stop_on_signals();
    absl::Status failed;
    const absl::Status status =
        client::Client(global.client_options())
            .watch_pose_database(
                [&](const v1::WatchPoseDatabaseResponse& progress) {
                    const bool read =
                        print_line(global.json ? to_json(progress).dump() : progress_text(progress));
                    if (!read || options.follow) return read;
                    if (progress.state() == v1::POSE_DATABASE_STATE_FAILED)
                        failed = absl::InternalError(progress.message());
                    return progress.state() == v1::POSE_DATABASE_STATE_BUILDING ||
                           progress.state() == v1::POSE_DATABASE_STATE_NOT_STARTED;
                },
                stream);
    if (!failed.ok()) return failed;
    return absl::IsCancelled(status) ? absl::OkStatus() : status;
}

}  // namespace

void add_poses_verb(CLI::App& app, GlobalOptions& global, Run& run) {
    const auto options = std::make_shared<PosesOptions>();
    CLI::App* poses = app.add_subcommand("poses", "Manage the pose database used to re-initialise tracking");
    poses->require_subcommand(1);
    const auto add = [&](const char* name, const char* help,
                         absl::Status (*act)(const GlobalOptions&, const PosesOptions&)) {
        return add_action(*poses, global, run, options, name, help, act);
    };
    add("list", "List pose labels", run_list)->add_flag("--user", options->user_only, "Only user poses");

    CLI::App* one = add("add", "Add the current pose, or the given one (acquires control)", run_add);
    one->add_option("LABEL", options->label, "Label of the new pose")->required();
    one->add_option("--coordinate", options->coordinates,
                    "NAME=DEGREES, such as knee_angle_l=90; repeatable (default of the others: 0)")
        ->allow_extra_args(false);
    one->add_option("--subject", options->subject_id,
                    "Subject whose pose is added (id; default: the only one)");
    add_operator_option(*one, options->operator_name);

    CLI::App* remove = add("delete", "Delete all poses with a label (acquires control)", run_delete);
    remove->add_option("LABEL", options->label, "Label shown by `poses list`")->required();
    add_operator_option(*remove, options->operator_name);
    add_yes_option(*remove, options->yes);

    CLI::App* import = add("import", "Add the poses of a BVH file (acquires control)", run_import);
    import->add_option("FILE", options->file, "BVH file")->required();
    import->add_option("--label", options->label, "Label of its poses (default: the file name)");
    import->add_option("--interval", options->interval_s, "Time between two poses (s; 0: 0.1)")
        ->check(CLI::Range(0.0, 3600.0));
    add_operator_option(*import, options->operator_name);

    add("watch", "Show the build progress of the database", run_watch)
        ->add_flag("--follow", options->follow, "Keep watching afterwards");
}

}  // namespace kinevox::cli
