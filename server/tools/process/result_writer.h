// Writes the results of `kinevox process`: tables, and optionally silhouettes and volumes.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "server/pipeline/frame_result.h"
#include "server/recording/csv_tables.h"

namespace kinevox {

// The tables besides the poses. Each result adds a row per table; events.csv any number of rows.
//   volume.csv          frame,subject,voxel_mm,voxels,volume_litres,min_x,...,max_z (m, around the occupied
//   voxels) timing.csv          frame,segmentation_ms,tracking_ms,hull_ms,colouring_ms,pose_ms,total_ms
//   track.csv           frame,time_s,subject,centre_x_m,centre_y_m,centre_z_m,centre_std_m,used_camera_count
//   silhouette_iou.csv  frame,subject, then per camera: IoU of the volume's projection and the silhouette,
//   0..1 events.csv          frame,time_s,subject,kind,camera,message
// Cells without a value are empty; subject is empty while none is tracked.
class ResultTables {
  public:
    explicit ResultTables(const std::vector<std::string>& camera_names);
    void add(const FrameResult& result);
    const std::vector<Table>& tables() const { return tables_; }

  private:
    void add_subject(std::uint64_t frame, double time_s, const SubjectResult& result);

    std::size_t camera_count_;
    std::vector<Table> tables_;
};

struct ResultWriterOptions {
    bool save_silhouettes = false;  // silhouettes/CAMERA/000000.png, the sharp ones
    bool save_volumes = false;      // volumes/000000.ply
    bool save_hulls = false;        // hulls/000000.ply: the volumes before colour carving
    int threads = 2;                // compress and write images and volumes
    int max_waiting = 8;            // frame sets not yet written, beyond which add() blocks
};

// Writes into a hidden folder inside the output folder; finish() moves the results to their place, so that
// they are always complete. Of several versions of the results one is kept. Used by one thread.
class ResultWriter {
  public:
    static absl::StatusOr<std::unique_ptr<ResultWriter>> create(const std::filesystem::path& folder,
                                                                std::vector<std::string> camera_names,
                                                                const ResultWriterOptions& options = {});
    // Without finish() it removes everything.
    virtual ~ResultWriter() = default;

    // What follows is another version of the results, from the first frame on.
    virtual absl::Status begin_version() = 0;
    // Results in the order of frames. Returns the first error met so far.
    virtual absl::Status add(FrameResultPtr result) = 0;
    // An additional table.
    virtual void add_table(Table table) = 0;
    // Blocks until all is written, then replaces the results of an earlier run by a version, from 0 on.
    virtual absl::Status finish(int version) = 0;
};

}  // namespace kinevox
