#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "client/cli/verbs.h"
#include "client/lib/image_file.h"
#include "client/lib/volume_image.h"
#include "common/ply.h"

namespace kinevox::cli {
namespace {

struct SnapshotOptions {
    std::filesystem::path out;
    std::string camera;  // empty: the first
    int height_px = 480;
    bool whole_picture = false;
    double wait_s = 15;  // for somebody to be tracked
};

absl::StatusOr<Camera> choose_camera(client::Client& client, const std::string& name) {
    const auto cameras = client.cameras();
    if (!cameras.ok()) return cameras.status();
    if (cameras->empty()) return absl::FailedPreconditionError("the daemon has no camera");
    if (name.empty()) return cameras->front();
    const auto found = std::ranges::find(*cameras, name, &Camera::name);
    if (found == cameras->end())
        return absl::NotFoundError(fmt::format("there is no camera '{}'; see `kinevox cameras`", name));
    return *found;
}

// A volume and the same frame set's picture. Both streams run on their own clocks, so pictures are gathered
// until one has the sequence number of a volume.
struct Pair {
    client::VolumeFrame volume;
    client::PreviewFrame preview;
};

absl::StatusOr<Pair> take_pair(client::Client& client, const Camera& camera, const SnapshotOptions& options,
                               std::stop_token stop) {
    std::mutex mutex;
    std::vector<client::VolumeFrame> volumes;
    std::vector<client::PreviewFrame> previews;
    std::optional<Pair> pair;
    bool anybody = false;
    constexpr std::size_t kKept = 12;
    std::stop_source done;
    const std::stop_callback pass_on(stop, [&] { done.request_stop(); });
    const auto match = [&] {  // mutex held
        for (const client::VolumeFrame& v : volumes)
            for (const client::PreviewFrame& p : previews)
                if (v.header.sequence() == p.header.sequence()) pair = Pair{v, p};
        if (pair) done.request_stop();
        if (volumes.size() > kKept) volumes.erase(volumes.begin());
        if (previews.size() > kKept) previews.erase(previews.begin());
        return !pair;
    };
    client::StreamOptions stream;
    stream.stop = done.get_token();
    stream.max_silence = std::chrono::milliseconds(static_cast<std::int64_t>(options.wait_s * 1000));

    absl::Status preview_status;
    std::thread preview_thread([&] {
        v1::StreamPreviewsRequest request;
        request.set_camera(camera.name);
        request.set_max_width_px(camera.width);
        request.set_jpeg_quality(92);
        request.set_max_rate_hz(30);
        preview_status = client.stream_previews(
            request,
            [&](const client::PreviewFrame& frame) {
                const std::scoped_lock lock(mutex);
                if (!frame.image.data.empty()) previews.push_back(frame);
                return match();
            },
            stream);
        if (!preview_status.ok() && !absl::IsCancelled(preview_status)) done.request_stop();
    });
    const auto deadline = std::chrono::steady_clock::now() + stream.max_silence;
    const absl::Status volume_status = client.stream_volumes(
        {},
        [&](const client::VolumeFrame& frame) {
            const std::scoped_lock lock(mutex);
            anybody = anybody || frame.volume;
            if (frame.volume && !frame.volume->bricks.empty()) volumes.push_back(frame);
            return match() && std::chrono::steady_clock::now() < deadline;
        },
        stream);
    done.request_stop();
    preview_thread.join();
    if (pair) return *pair;
    for (const absl::Status& status : {volume_status, preview_status})
        if (!status.ok() && !absl::IsCancelled(status)) return status;
    if (stop.stop_requested()) return absl::CancelledError("stopped");
    return absl::DeadlineExceededError(
        anybody
            ? fmt::format("no volume and picture of one frame set within {:g} s; allow it more with --wait",
                          options.wait_s)
            : fmt::format(
                  "nobody was tracked within {:g} s; see `kinevox status`, or allow it more with --wait",
                  options.wait_s));
}

absl::Status run_snapshot(const Common& common, const SnapshotOptions& options) {
    const std::stop_token stop = stop_on_signals();
    client::Client client(common.client_options());
    const auto camera = choose_camera(client, options.camera);
    if (!camera.ok()) return camera.status();
    const auto pair = take_pair(client, *camera, options, stop);
    if (!pair.ok()) return pair.status();
    const Volume& volume = *pair->volume.volume;

    const std::filesystem::path ply = options.out / "volume.ply", png = options.out / "snapshot.png";
    if (const absl::Status written = write_volume_ply(volume, ply); !written.ok()) return written;
    // Drawn twice as large and scaled down, so that edges are smooth.
    const client::Window window = options.whole_picture ? client::Window{0, 0, camera->width, camera->height}
                                                        : client::window_around(volume, *camera);
    const Camera part = client::cropped(*camera, window);
    const double scale = 2.0 * options.height_px / part.height;
    const client::Image same_view = client::scaled_to_height(
        client::render_volume(volume, client::scaled(part, scale)), options.height_px);
    const int side = options.height_px;
    const Camera oblique =
        client::oblique_camera(volume, camera->centre_in_world(), 0.9, 0.45, 2 * side * 4 / 5, 2 * side);
    const client::Image oblique_view =
        client::scaled_to_height(client::render_volume(volume, oblique), options.height_px);
    const client::Image together = client::side_by_side(
        {client::scaled_to_height(client::cropped(pair->preview.image, window), options.height_px), same_view,
         oblique_view});
    if (const absl::Status written = client::write_png(together, png); !written.ok()) return written;

    if (common.json)
        print_line(nlohmann::ordered_json({{"sequence", pair->volume.header.sequence()},
                                           {"camera", camera->name},
                                           {"voxels", voxel_count(volume)},
                                           {"litres", pair->volume.litres},
                                           {"ply", ply.string()},
                                           {"png", png.string()}})
                       .dump());
    else
        print_line(fmt::format("frame {}: {} voxels, {:.1f} l; wrote {} and {}",
                               pair->volume.header.sequence(), voxel_count(volume), pair->volume.litres,
                               ply.string(), png.string()));
    return absl::OkStatus();
}

}  // namespace

void add_snapshot_verb(CLI::App& app, Common& common, Run& run) {
    const auto options = std::make_shared<SnapshotOptions>();
    CLI::App* snapshot =
        app.add_subcommand("snapshot", "The newest volume as PLY, and a picture of it beside a camera's");
    add_common_options(*snapshot, common);
    snapshot->add_option("--out", options->out, "Folder for volume.ply and snapshot.png")->required();
    snapshot->add_option("--camera", options->camera, "Which camera's picture; the first if not given");
    snapshot->add_option("--height", options->height_px, "Of snapshot.png, px")
        ->check(CLI::Range(64, 4096))
        ->capture_default_str();
    snapshot->add_flag("--whole-picture", options->whole_picture, "Do not crop to where the volume is");
    snapshot->add_option("--wait", options->wait_s, "Seconds to wait for somebody to be tracked")
        ->check(CLI::Range(0.1, 3600.0))
        ->capture_default_str();
    snapshot->callback([&, options] { run = [&common, options] { return run_snapshot(common, *options); }; });
}

}  // namespace kinevox::cli
