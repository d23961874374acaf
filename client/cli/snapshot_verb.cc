// `kinevox snapshot`.
#include <fmt/format.h>
#include <fmt/ranges.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <span>

#include "client/cli/line_stream.h"
#include "client/cli/verbs.h"
#include "client/lib/image.h"
#include "common/progress_line.h"
#include "common/volume.h"

namespace kinevox::cli {
namespace {

struct SnapshotOptions {
    std::filesystem::path out;
    std::string camera;  // empty: the first
    int image_height_px = 480;
    bool full_image = false, overwrite = false;
    std::uint32_t subject = 0;  // 0: all
    double wait_s = 15;         // for a tracked subject
};

absl::StatusOr<Camera> choose_camera(client::Client& client, const std::string& name) {
    const auto cameras = client.cameras();
    if (!cameras.ok()) return cameras.status();
    if (cameras->empty()) return absl::FailedPreconditionError("the daemon has no cameras");
    if (name.empty()) return cameras->front();
    const auto found = std::ranges::find(*cameras, name, &Camera::name);
    if (found == cameras->end())
        return absl::NotFoundError(fmt::format("unknown camera '{}'; see `kinevox cameras`", name));
    return *found;
}

// A volume and an image of the same frame set. The two streams are independent, so messages are collected
// until two have the same sequence number.
struct Pair {
    client::VolumeFrame frame;
    client::PreviewFrame preview;
};

absl::StatusOr<Pair> wait_for_pair(client::Client& client, const Camera& camera,
                                   const SnapshotOptions& options, std::stop_token stop) {
    std::mutex mutex;
    std::vector<client::VolumeFrame> frames;
    std::vector<client::PreviewFrame> previews;
    std::optional<Pair> pair;
    bool tracked = false;
    constexpr std::size_t kMaxKept = 12;
    std::stop_source done;
    const std::stop_callback forward(stop, [&] { done.request_stop(); });
    const auto match = [&] {  // mutex held
        for (const client::VolumeFrame& v : frames)
            for (const client::PreviewFrame& p : previews)
                if (v.header.sequence() == p.header.sequence()) pair = Pair{v, p};
        if (pair) done.request_stop();
        if (frames.size() > kMaxKept) frames.erase(frames.begin());
        if (previews.size() > kMaxKept) previews.erase(previews.begin());
        return !pair;
    };
    client::StreamOptions stream;
    stream.stop = done.get_token();
    stream.idle_timeout = std::chrono::milliseconds(static_cast<std::int64_t>(options.wait_s * 1000));

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
    const auto deadline = std::chrono::steady_clock::now() + stream.idle_timeout;
    const absl::Status volume_status = client.stream_volumes(
        {},
        [&](client::VolumeFrame frame) {
            const std::scoped_lock lock(mutex);
            client::keep_subject(frame, options.subject);
            tracked = tracked || !frame.subjects.empty();
            std::erase_if(frame.subjects, [](const client::SubjectVolume& subject) {
                return !subject.volume || subject.volume->bricks.empty();
            });
            if (!frame.subjects.empty()) frames.push_back(std::move(frame));
            return match() && std::chrono::steady_clock::now() < deadline;
        },
        stream);
    done.request_stop();
    preview_thread.join();
    if (pair) return *pair;
    for (const absl::Status& status : {volume_status, preview_status})
        if (!status.ok() && !absl::IsCancelled(status)) return status;
    if (stop.stop_requested()) return absl::CancelledError("stopped");
    if (tracked)
        return absl::DeadlineExceededError(
            fmt::format("no volume and image of one frame set within {:g} s; raise --wait", options.wait_s));
    return absl::DeadlineExceededError(
        fmt::format("no subject{} within {:g} s; see `kinevox status`, or raise --wait",
                    options.subject ? fmt::format(" {}", options.subject) : "", options.wait_s));
}

// The first subject's file has no id in its name, as in `kinevox stream volumes --format ply-folder`.
std::vector<std::filesystem::path> ply_files(const std::filesystem::path& folder,
                                             const client::VolumeFrame& frame) {
    std::vector<std::filesystem::path> files;
    for (const client::SubjectVolume& subject : frame.subjects)
        files.push_back(folder / (files.empty()
                                      ? "volume.ply"
                                      : fmt::format("volume_s{}.ply", subject.subject.subject_id())));
    return files;
}

// The camera's image, the volumes from its viewpoint, and from the side.
client::Image comparison(const Camera& camera, const client::Image& image, std::span<const Volume> volumes,
                         const SnapshotOptions& options) {
    // Rendered at twice the size and scaled down, for smooth edges.
    const client::Window window = options.full_image ? client::Window{0, 0, camera.width, camera.height}
                                                     : client::window_around(volumes, camera);
    const Camera part = client::cropped(camera, window);
    const double scale = 2.0 * options.image_height_px / part.height;
    const client::Image same_view = client::scaled_to_height(
        client::render_volumes(volumes, client::scaled(part, scale)), options.image_height_px);
    const int side = options.image_height_px;
    const Camera oblique =
        client::oblique_camera(volumes, camera.centre_in_world(), 0.9, 0.45, 2 * side * 4 / 5, 2 * side);
    const client::Image oblique_view =
        client::scaled_to_height(client::render_volumes(volumes, oblique), options.image_height_px);
    return client::side_by_side(
        {client::scaled_to_height(client::cropped(image, window), side), same_view, oblique_view});
}

void print_snapshot(bool json, const client::VolumeFrame& frame, const std::string& camera,
                    const std::vector<std::filesystem::path>& plys, const std::filesystem::path& png) {
    nlohmann::ordered_json subjects = nlohmann::ordered_json::array();
    std::vector<std::string> texts, files;
    for (std::size_t n = 0; n < plys.size(); ++n) {
        const client::SubjectVolume& subject = frame.subjects[n];
        const std::uint32_t id = subject.subject.subject_id();
        const std::size_t voxels = voxel_count(*subject.volume);
        subjects.push_back({{"subject_id", id},
                            {"voxel_count", voxels},
                            {"volume_litres", subject.volume_litres},
                            {"ply", plys[n].string()}});
        texts.push_back(fmt::format("{}{} voxels, {:.1f} l",
                                    plys.size() > 1 ? fmt::format("subject {}: ", id) : "", voxels,
                                    subject.volume_litres));
        files.push_back(plys[n].string());
    }
    if (json) {
        nlohmann::ordered_json out{{"sequence", frame.header.sequence()}, {"camera", camera}};
        out.update(subjects[0]);  // the first, or only, subject
        out["png"] = png.string();
        out["subjects"] = std::move(subjects);
        print_line(out.dump());
    } else {
        print_line(fmt::format("frame {}: {}; wrote {} and {}", frame.header.sequence(),
                               fmt::join(texts, "; "), fmt::join(files, ", "), png.string()));
    }
}

absl::Status run_snapshot(const GlobalOptions& global, const SnapshotOptions& options) {
    const std::filesystem::path ply = options.out / "volume.ply", png = options.out / "snapshot.png";
    for (const auto& file : {ply, png})
        if (absl::Status free = check_overwrite(options.overwrite, file.string()); !free.ok()) return free;
    const std::stop_token stop = stop_on_signals();
    client::Client client(global.client_options());
    const auto camera = choose_camera(client, options.camera);
    if (!camera.ok()) return camera.status();
    ProgressLine line(global.json);
    line.draw("waiting for a subject ...");
    const auto pair = wait_for_pair(client, *camera, options, stop);
    line.clear();
    if (!pair.ok()) return pair.status();
    const std::vector<std::filesystem::path> plys = ply_files(options.out, pair->frame);
    std::vector<Volume> volumes;
    for (std::size_t n = 0; n < plys.size(); ++n) {
        if (absl::Status free = check_overwrite(options.overwrite, plys[n].string()); !free.ok()) return free;
        volumes.push_back(*pair->frame.subjects[n].volume);
    }
    for (std::size_t n = 0; n < plys.size(); ++n)
        if (absl::Status written = write_volume_ply(volumes[n], plys[n]); !written.ok()) return written;
    const client::Image image = comparison(*camera, pair->preview.image, volumes, options);
    if (absl::Status written = client::write_png(image, png); !written.ok()) return written;
    print_snapshot(global.json, pair->frame, camera->name, plys, png);
    return absl::OkStatus();
}

}  // namespace

void add_snapshot_verb(CLI::App& app, GlobalOptions& global, Run& run) {
    const auto options = std::make_shared<SnapshotOptions>();
    CLI::App* snapshot =
        add_action(app, global, run, options, "snapshot",
                   "Save the latest volume of each subject as PLY and a comparison image", run_snapshot);
    snapshot->add_option("--out", options->out, "Folder for volume.ply and snapshot.png")->required();
    add_overwrite_option(*snapshot, options->overwrite);
    snapshot->add_option("--camera", options->camera, "Camera of the image (default: the first)");
    add_subject_option(*snapshot, options->subject);
    snapshot->add_option("--image-height", options->image_height_px, "Height of snapshot.png (px)")
        ->check(CLI::Range(64, 4096))
        ->capture_default_str();
    snapshot->add_flag("--full-image", options->full_image, "Do not crop to the volume");
    snapshot->add_option("--wait", options->wait_s, "Time to wait for a subject (s)")
        ->check(CLI::Range(0.1, 3600.0))
        ->capture_default_str();
}

}  // namespace kinevox::cli
