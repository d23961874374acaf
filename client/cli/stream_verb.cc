#include <fmt/format.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "client/cli/json.h"
#include "client/cli/line_stream.h"
#include "client/cli/stream_poses.h"
#include "common/ply.h"

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

constexpr const char* kCsvHead =
    "frame,capture_time_ns,subject_id,voxel_mm,voxels,volume_litres,min_x,min_y,min_z,max_x,max_y,max_z,"
    "bytes,missed,"
    "total_ms";

// Cells of a frame without a volume stay empty.
std::string csv_line(const client::VolumeFrame& frame) {
    const v1::StreamHeader& header = frame.header;
    std::string out =
        fmt::format("{},{},{},", header.sequence(), header.capture_time_ns(), header.subject_id());
    std::optional<Bounds> box;
    if (frame.volume) box = bounds_of(frame.volume->grid, surface_voxels(*frame.volume));
    if (frame.volume)
        out += fmt::format("{:g},{},{:.3f},", frame.volume->grid.voxel_m * 1000, voxel_count(*frame.volume),
                           frame.litres);
    else
        out += ",,,";
    if (box)
        out += fmt::format("{:.4f},{:.4f},{:.4f},{:.4f},{:.4f},{:.4f},", box->low.x, box->low.y, box->low.z,
                           box->high.x, box->high.y, box->high.z);
    else
        out += ",,,,,,";
    return out + fmt::format("{},{},{:.3f}", frame.bytes, header.missed(), header.times().total_ms());
}

std::string json_line(const client::VolumeFrame& frame) {
    nlohmann::ordered_json out = to_json(frame.header);
    out["subject"] = frame.subject ? to_json(*frame.subject) : nlohmann::ordered_json(nullptr);
    out["volume"] = nullptr;
    if (frame.volume) {
        const std::vector<VoxelIndex> surface = surface_voxels(*frame.volume);
        nlohmann::ordered_json volume = {{"voxel_m", frame.volume->grid.voxel_m},
                                         {"voxels", voxel_count(*frame.volume)},
                                         {"surface_voxels", surface.size()},
                                         {"coloured", !frame.volume->colours.empty()},
                                         {"litres", frame.litres},
                                         {"bytes", frame.bytes}};
        if (const auto box = bounds_of(frame.volume->grid, surface)) {
            volume["min_in_world_m"] = {box->low.x, box->low.y, box->low.z};
            volume["max_in_world_m"] = {box->high.x, box->high.y, box->high.z};
        }
        out["volume"] = std::move(volume);
    }
    return out.dump();
}

v1::StreamVolumesRequest request_of(const VolumesOptions& options) {
    v1::StreamVolumesRequest request;
    if (options.level >= 0) request.set_level(options.level);
    if (options.max_voxel_mm > 0) request.set_max_voxel_m(options.max_voxel_mm / 1000);
    request.set_without_colours(options.no_colours);
    request.set_max_rate_hz(options.rate_hz);
    request.set_delivery(options.delivery());
    return request;
}

absl::Status run_volumes(const Common& common, const VolumesOptions& options) {
    const bool ply = options.format == "ply-folder";
    if (ply && options.out.empty())
        return absl::InvalidArgumentError("--format ply-folder needs the folder: give --out DIR");
    absl::StatusOr<LineWriter> writer = LineWriter::open(ply ? std::filesystem::path() : options.out);
    if (!writer.ok()) return writer.status();
    const bool csv = options.format == "csv" && !common.json;
    if (csv) writer->print(kCsvHead);
    const client::StreamOptions stream = options.stream();  // blocks signals, so before gRPC starts threads
    int count = 0;
    absl::Status written;
    const absl::Status status =
        client::Client(common.client_options())
            .stream_volumes(
                request_of(options),
                [&](const client::VolumeFrame& frame) {
                    if (ply && frame.volume) {
                        written = write_volume_ply(
                            *frame.volume, options.out / fmt::format("{:06}.ply", frame.header.sequence()));
                        if (!written.ok()) return false;
                    }
                    if (!ply || common.json)
                        if (!writer->print(csv ? csv_line(frame) : json_line(frame))) return false;
                    return ++count != options.frames;
                },
                stream);
    if (!written.ok()) return written;
    if (written = writer->close(); !written.ok()) return written;
    return absl::IsCancelled(status) ? absl::OkStatus() : status;
}

}  // namespace

void add_stream_verb(CLI::App& app, Common& common, Run& run) {
    CLI::App* stream =
        app.add_subcommand("stream", "Results as they come, to standard output, until stopped");
    stream->require_subcommand(1);
    const auto options = std::make_shared<VolumesOptions>();
    CLI::App* volumes = stream->add_subcommand("volumes", "Volumes: a line each, or a PLY file each");
    add_common_options(*volumes, common);
    add_line_stream_options(*volumes, *options, {"ply-folder"},
                            "File for the lines, or folder for the PLY files of --format ply-folder");
    auto* voxel =
        volumes->add_option("--max-voxel-mm", options->max_voxel_mm, "Coarsest voxel edge that will do")
            ->check(CLI::PositiveNumber);
    volumes->add_option("--level", options->level, "Halvings of the resolution")
        ->check(CLI::Range(0, 5))
        ->excludes(voxel);
    volumes->add_flag("--no-colours", options->no_colours, "Shape alone");
    volumes->callback([&, options] { run = [&common, options] { return run_volumes(common, *options); }; });
    add_pose_streams(*stream, common, run);
}

}  // namespace kinevox::cli
