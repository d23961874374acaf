// `kinevox stream`: results line by line.
#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "client/cli/line_stream.h"
#include "client/cli/output.h"
#include "client/cli/verbs.h"
#include "client/lib/pose_csv.h"
#include "common/volume.h"

namespace kinevox::cli {
namespace {

struct VolumesOptions : LineStreamOptions {
    double max_voxel_mm = 0;  // 0: as captured
    int level = -1;
    bool no_colours = false;
};

// The box of the occupied voxels, metres, world; nothing for an empty volume.
struct Bounds {
    Vec3 low, high;
};
std::optional<Bounds> bounds_of(const VolumeGrid& grid, const std::vector<VoxelIndex>& surface) {
    if (surface.empty()) return std::nullopt;
    std::array<int, 3> low{surface[0].i, surface[0].j, surface[0].k}, high = low;
    for (const VoxelIndex& v : surface) {
        low = {std::min(low[0], v.i), std::min(low[1], v.j), std::min(low[2], v.k)};
        high = {std::max(high[0], v.i), std::max(high[1], v.j), std::max(high[2], v.k)};
    }
    const auto corner = [&](int i, int j, int k) {
        return grid.origin_in_world + grid.voxel_m * Vec3{1.0 * i, 1.0 * j, 1.0 * k};
    };
    return Bounds{corner(low[0], low[1], low[2]), corner(high[0] + 1, high[1] + 1, high[2] + 1)};
}

constexpr const char* kCsvHeader =
    "frame,capture_time_ns,subject,sequence,voxel_mm,voxels,volume_litres,min_x,min_y,min_z,max_x,max_y,max_"
    "z,"
    "encoded_bytes,missed_count,total_ms";

// Cells of a frame without a subject or volume stay empty.
std::string csv_line(const v1::StreamHeader& header, const client::SubjectVolume* subject) {
    std::string out =
        fmt::format("{},{},{},{},", client::frame_of(header), header.capture_time_ns(),
                    subject ? fmt::to_string(subject->subject.subject_id()) : "", header.sequence());
    const Volume* const volume = subject && subject->volume ? &*subject->volume : nullptr;
    std::optional<Bounds> box;
    if (volume) box = bounds_of(volume->grid, surface_voxels(*volume));
    if (volume)
        out += fmt::format("{:g},{},{:.3f},", volume->grid.voxel_m * 1000, voxel_count(*volume),
                           subject->volume_litres);
    else
        out += ",,,";
    if (box)
        out += fmt::format("{:.4f},{:.4f},{:.4f},{:.4f},{:.4f},{:.4f},", box->low.x, box->low.y, box->low.z,
                           box->high.x, box->high.y, box->high.z);
    else
        out += ",,,,,,";
    return out + fmt::format("{},{},{:.3f}", subject ? subject->encoded_bytes : 0, header.missed_count(),
                             header.stage_times().total_ms());
}

nlohmann::ordered_json subject_json(const client::SubjectVolume& subject) {
    nlohmann::ordered_json out{{"subject", to_json(subject.subject)}, {"volume", nullptr}};
    if (!subject.volume) return out;
    const std::vector<VoxelIndex> surface = surface_voxels(*subject.volume);
    nlohmann::ordered_json volume = {
        {"voxel_m", subject.volume->grid.voxel_m}, {"voxel_count", voxel_count(*subject.volume)},
        {"surface_voxel_count", surface.size()},   {"coloured", !subject.volume->colours.empty()},
        {"volume_litres", subject.volume_litres},  {"encoded_bytes", subject.encoded_bytes}};
    if (const auto box = bounds_of(subject.volume->grid, surface)) {
        volume["min_in_world_m"] = {box->low.x, box->low.y, box->low.z};
        volume["max_in_world_m"] = {box->high.x, box->high.y, box->high.z};
    }
    out["volume"] = std::move(volume);
    return out;
}

std::string json_line(const client::VolumeFrame& frame) {
    nlohmann::ordered_json out = to_json(frame.header);
    nlohmann::ordered_json& subjects = out["subjects"] = nlohmann::ordered_json::array();
    for (const client::SubjectVolume& subject : frame.subjects) subjects.push_back(subject_json(subject));
    return out.dump();
}

bool print_csv(LineWriter& writer, const client::VolumeFrame& frame) {
    if (frame.subjects.empty()) return writer.print(csv_line(frame.header, nullptr));
    for (const client::SubjectVolume& subject : frame.subjects)
        if (!writer.print(csv_line(frame.header, &subject))) return false;
    return true;
}

// A file per subject: FRAME.ply of the first, FRAME_sID.ply of others.
absl::Status write_plys(const std::filesystem::path& folder, const client::VolumeFrame& frame) {
    for (const client::SubjectVolume& subject : frame.subjects) {
        if (!subject.volume) continue;
        const std::string name =
            &subject == frame.first_subject()
                ? fmt::format("{:06}.ply", client::frame_of(frame.header))
                : fmt::format("{:06}_s{}.ply", client::frame_of(frame.header), subject.subject.subject_id());
        if (absl::Status written = write_volume_ply(*subject.volume, folder / name); !written.ok())
            return written;
    }
    return absl::OkStatus();
}

v1::StreamVolumesRequest request_of(const VolumesOptions& options) {
    v1::StreamVolumesRequest request;
    if (options.level >= 0) request.set_downsample_level(options.level);
    if (options.max_voxel_mm > 0) request.set_max_voxel_m(options.max_voxel_mm / 1000);
    request.set_omit_colours(options.no_colours);
    request.set_max_rate_hz(options.max_rate_hz);
    request.set_delivery(options.delivery());
    return request;
}

absl::Status run_volumes(const GlobalOptions& global, const VolumesOptions& options) {
    const bool ply = options.format == "ply-folder";
    if (ply && options.out.empty())
        return absl::InvalidArgumentError("--format ply-folder needs a folder; give --out");
    if (ply)
        if (absl::Status free = check_overwrite(options.overwrite, options.out.string()); !free.ok())
            return free;
    absl::StatusOr<LineWriter> writer =
        LineWriter::open(ply ? std::filesystem::path() : options.out, options.overwrite);
    if (!writer.ok()) return writer.status();
    const bool csv = options.format == "csv" && !global.json;
    if (csv) writer->print(kCsvHeader);
    const client::StreamOptions stream = options.stream();  // blocks signals, so before gRPC starts threads
    int count = 0;
    absl::Status written;
    const absl::Status status =
        client::Client(global.client_options())
            .stream_volumes(
                request_of(options),
                [&](client::VolumeFrame frame) {
                    client::keep_subject(frame, options.subject);
                    if (ply) written = write_plys(options.out, frame);
                    if (!written.ok()) return false;
                    if (!ply || global.json)
                        if (!(csv ? print_csv(*writer, frame) : writer->print(json_line(frame))))
                            return false;
                    return ++count != options.frames;
                },
                stream);
    if (!written.ok()) return written;
    if (written = writer->close(); !written.ok()) return written;
    return absl::IsCancelled(status) ? absl::OkStatus() : status;
}

}  // namespace

void add_stream_verb(CLI::App& app, GlobalOptions& global, Run& run) {
    CLI::App* stream = app.add_subcommand("stream", "Write results to standard output until stopped");
    stream->require_subcommand(1);
    const auto options = std::make_shared<VolumesOptions>();
    CLI::App* volumes = add_action(*stream, global, run, options, "volumes",
                                   "One line or one PLY file per volume", run_volumes);
    add_line_stream_options(*volumes, *options, {"ply-folder"},
                            "Output file (default: standard output), or folder with --format ply-folder");
    auto* voxel =
        volumes->add_option("--max-voxel-mm", options->max_voxel_mm, "Largest acceptable voxel edge (mm)")
            ->check(CLI::PositiveNumber);
    volumes->add_option("--level", options->level, "Number of times the resolution is halved")
        ->check(CLI::Range(0, 5))
        ->excludes(voxel);
    volumes->add_flag("--no-colours", options->no_colours, "Omit colours");
    add_pose_streams(*stream, global, run);
}

}  // namespace kinevox::cli
