#include "server/tools/process/tables.h"

#include <fmt/format.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <iterator>
#include <optional>

namespace kinevox {
namespace {

enum TableIndex { kVolume, kTiming, kTrack, kSilhouetteIou, kEvents };

// The box around the occupied voxels, m.
struct Extent {
    Vec3 min_in_world, max_in_world;
};

std::optional<Extent> extent_of(const Volume& volume) {
    constexpr int kNone = 1 << 30;
    int low[3] = {kNone, kNone, kNone}, high[3] = {-kNone, -kNone, -kNone};  // voxels, half open
    const auto include = [&](int axis, int first, int last) {
        low[axis] = std::min(low[axis], first);
        high[axis] = std::max(high[axis], last);
    };
    for (const VolumeBrick& brick : volume.bricks) {
        std::uint64_t layers = 0;
        for (int z = 0; z < 8; ++z) {
            if (brick.occupancy[z] == 0) continue;
            layers |= brick.occupancy[z];
            include(2, 8 * brick.z + z, 8 * brick.z + z + 1);
        }
        if (layers == 0) continue;
        include(1, 8 * brick.y + std::countr_zero(layers) / 8,
                8 * brick.y + 8 - std::countl_zero(layers) / 8);
        std::uint64_t columns = layers | layers >> 32;
        columns |= columns >> 16;
        columns = (columns | columns >> 8) & 0xff;
        include(0, 8 * brick.x + std::countr_zero(columns), 8 * brick.x + 64 - std::countl_zero(columns));
    }
    if (low[0] == kNone) return std::nullopt;
    const Vec3 o = volume.grid.origin_in_world;
    const double edge = volume.grid.voxel_m;
    return Extent{{o.x + edge * low[0], o.y + edge * low[1], o.z + edge * low[2]},
                  {o.x + edge * high[0], o.y + edge * high[1], o.z + edge * high[2]}};
}

template <class... T>
void append(std::string& to, fmt::format_string<T...> format, T&&... values) {
    fmt::format_to(std::back_inserter(to), format, std::forward<T>(values)...);
}

std::string subject_cell(std::uint32_t subject_id) {
    return subject_id ? fmt::to_string(subject_id) : "";
}

}  // namespace

ResultTables::ResultTables(const std::vector<std::string>& camera_names) {
    tables_ = {
        {"volume.csv", "frame,subject,voxel_mm,voxels,volume_litres,min_x,min_y,min_z,max_x,max_y,max_z\n"},
        {"timing.csv", "frame,segmentation_ms,tracking_ms,hull_ms,colouring_ms,pose_ms,total_ms\n"},
        {"track.csv",
         "frame,time_s,subject,centre_x_m,centre_y_m,centre_z_m,centre_std_m,used_camera_count\n"},
        {"silhouette_iou.csv", "frame,subject"},
        {"events.csv", "frame,time_s,subject,kind,camera,message\n"}};
    for (const std::string& name : camera_names)
        tables_[kSilhouetteIou].text.append(1, ',').append(csv_cell(name));
    tables_[kSilhouetteIou].text += '\n';
}

void ResultTables::add(const FrameResult& result) {
    const auto frame = result.sequence;
    const double time_s = 1e-9 * static_cast<double>(result.capture_time_ns);

    const std::string subject = subject_cell(result.subject ? result.subject->subject_id : 0);

    std::string& volume = tables_[kVolume].text;
    const auto extent = result.volume ? extent_of(*result.volume) : std::nullopt;
    if (result.volume)
        append(volume, "{},{},{:g},{},{:.3f}", frame, subject, 1000 * result.volume->grid.voxel_m,
               voxel_count(*result.volume), volume_litres(*result.volume));
    else
        append(volume, "{},{},,,", frame, subject);
    if (extent) {
        const Vec3 a = extent->min_in_world, b = extent->max_in_world;
        append(volume, ",{:.4f},{:.4f},{:.4f},{:.4f},{:.4f},{:.4f}\n", a.x, a.y, a.z, b.x, b.y, b.z);
    } else {
        volume += ",,,,,,\n";
    }

    const StageTimes& t = result.times;
    append(tables_[kTiming].text, "{},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f}\n", frame, t.segmentation_ms,
           t.tracking_ms, t.hull_ms, t.colouring_ms, t.pose_ms, t.total_ms);

    std::string& track = tables_[kTrack].text;
    if (result.subject) {
        const SubjectTrack& s = *result.subject;
        append(track, "{},{:.6f},{},{:.4f},{:.4f},{:.4f},{:.4f},{}\n", frame, time_s, subject,
               s.centre_in_world.x, s.centre_in_world.y, s.centre_in_world.z, s.centre_std_m,
               std::count(s.used_cameras.begin(), s.used_cameras.end(), true));
    } else {
        append(track, "{},{:.6f},,,,,,\n", frame, time_s);
    }

    std::string& iou = tables_[kSilhouetteIou].text;
    append(iou, "{},{}", frame, subject);
    for (const float value : result.silhouette_iou) {
        if (std::isnan(value))
            iou += ',';
        else
            append(iou, ",{:.4f}", value);
    }
    iou += '\n';

    for (const Event& event : result.events)
        append(tables_[kEvents].text, "{},{:.6f},{},{},{},{}\n", event.sequence,
               1e-9 * static_cast<double>(event.time_ns), subject_cell(event.subject_id),
               event_name(event.kind), csv_cell(event.camera), csv_cell(event.message));
}

}  // namespace kinevox
