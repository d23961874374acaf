// `kinevox poses`: the daemon's pose database.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>

#include "client/cli/action.h"
#include "client/cli/json.h"
#include "client/cli/report.h"
#include "client/cli/verbs.h"
#include "common/atomic_file.h"

namespace kinevox::cli {
namespace {

struct PosesOptions {
    std::string name = default_operator_name();
    std::string label, file;
    std::vector<std::string> coordinates;  // NAME=DEGREES
    double every_s = 0;
    bool added_only = false, follow = false;
};

absl::Status run_list(const Common& common, const PosesOptions& options) {
    auto response = client::Client(common.client_options()).list_poses();
    if (!response.ok()) return response.status();
    if (options.added_only) {
        auto& poses = *response->mutable_poses();
        poses.erase(
            std::remove_if(poses.begin(), poses.end(), [](const auto& pose) { return !pose.added(); }),
            poses.end());
    }
    if (common.json) {
        print_line(to_json(*response).dump());
        return absl::OkStatus();
    }
    for (const v1::PoseEntry& pose : response->poses())
        if (!print_line((pose.added() ? "added  " : "own    ") + pose.label())) break;
    return absl::OkStatus();
}

absl::Status run_add(const Common& common, const PosesOptions& options) {
    v1::AddPoseRequest request;
    request.set_label(options.label);
    for (const std::string& text : options.coordinates) {
        const std::size_t equals = text.find('=');
        double degrees = 0;
        if (equals == std::string::npos || !CLI::detail::lexical_cast(text.substr(equals + 1), degrees))
            return absl::InvalidArgumentError(
                fmt::format("'{}' is no coordinate; write NAME=DEGREES, such as knee_angle_l=90", text));
        (*request.mutable_coordinates_deg())[text.substr(0, equals)] = degrees;
    }
    return report<v1::AddPoseResponse>(
        common, client::Client(common.client_options()).add_pose(options.name, request),
        [](const auto& response) { return fmt::format("added; {} entries", response.entries()); });
}

absl::Status run_remove(const Common& common, const PosesOptions& options) {
    v1::RemovePoseRequest request;
    request.set_label(options.label);
    return report<v1::RemovePoseResponse>(
        common, client::Client(common.client_options()).remove_pose(options.name, request),
        [](const auto& response) { return fmt::format("removed; {} entries", response.entries()); });
}

absl::Status run_import(const Common& common, const PosesOptions& options) {
    auto text = read_file(options.file, 32 << 20);
    if (!text.ok()) return text.status();
    v1::ImportBvhRequest request;
    request.set_label(options.label.empty() ? std::filesystem::path(options.file).stem().string()
                                            : options.label);
    request.set_bvh(*std::move(text));
    request.set_every_s(options.every_s);
    return report<v1::ImportBvhResponse>(
        common, client::Client(common.client_options()).import_bvh(options.name, std::move(request)),
        [](const auto& response) {
            return fmt::format("{} poses added; {} entries", response.poses(), response.entries());
        });
}

std::string progress_text(const v1::WatchDatabaseResponse& progress) {
    std::string out = short_name(*v1::DatabaseState_descriptor()->FindValueByNumber(progress.state()));
    if (progress.state() == v1::DATABASE_STATE_BUILDING)
        out += fmt::format(" {:.0f} %", 100 * progress.part());
    if (progress.entries() > 0) out += fmt::format(", {} entries", progress.entries());
    return progress.message().empty() ? out : out + ": " + progress.message();
}

// Until nothing is being built any more.
absl::Status run_watch(const Common& common, const PosesOptions& options) {
    client::StreamOptions stream;
    stream.stop = stop_on_signals();
    absl::Status failed;
    const absl::Status status =
        client::Client(common.client_options())
            .watch_database(
                [&](const v1::WatchDatabaseResponse& progress) {
                    const bool read =
                        print_line(common.json ? to_json(progress).dump() : progress_text(progress));
                    if (!read || options.follow) return read;
                    if (progress.state() == v1::DATABASE_STATE_FAILED)
                        failed = absl::InternalError(progress.message());
                    return progress.state() == v1::DATABASE_STATE_BUILDING ||
                           progress.state() == v1::DATABASE_STATE_NONE;
                },
                stream);
    if (!failed.ok()) return failed;
    return absl::IsCancelled(status) ? absl::OkStatus() : status;
}

}  // namespace

void add_poses_verb(CLI::App& app, Common& common, Run& run) {
    const auto options = std::make_shared<PosesOptions>();
    CLI::App* poses = app.add_subcommand("poses", "The poses from which the daemon finds a body");
    poses->require_subcommand(1);
    const auto add = [&](const char* name, const char* help,
                         absl::Status (*act)(const Common&, const PosesOptions&)) {
        return add_action(*poses, common, run, options, name, help, act);
    };
    const auto add_name = [&](CLI::App* verb) {
        verb->add_option("--name", options->name, "Under which name control is taken")->capture_default_str();
    };

    add("list", "Their labels", run_list)
        ->add_flag("--added", options->added_only, "Only those that were added");

    CLI::App* one =
        add("add", "Add the pose that was measured last, or the one given (takes control for the moment)",
            run_add);
    one->add_option("label", options->label, "Under which it will be listed")->required();
    one->add_option("--set", options->coordinates,
                    "NAME=DEGREES of the body model, such as knee_angle_l=90; those not given are 0");
    add_name(one);

    CLI::App* remove =
        add("remove", "Take out all poses of a label (takes control for the moment)", run_remove);
    remove->add_option("label", options->label, "As it is listed")->required();
    add_name(remove);

    CLI::App* import =
        add("import", "Add the poses of a BVH file (takes control for the moment)", run_import);
    import->add_option("file", options->file, "The BVH file")->required();
    import->add_option("--label", options->label, "Of its poses; else the file's name");
    import->add_option("--every", options->every_s, "Seconds from one pose to the next; 0: 0.1")
        ->check(CLI::Range(0.0, 3600.0));
    add_name(import);

    add("watch", "How far the database is built, until it is", run_watch)
        ->add_flag("--follow", options->follow, "Go on afterwards");
}

}  // namespace kinevox::cli
