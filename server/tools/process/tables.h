// The tables of `kinevox process` besides the poses.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "server/pipeline/frame_result.h"
#include "server/recording/table.h"

namespace kinevox {

// Each result adds a row per table; events.csv any number of rows.
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
    std::vector<Table> tables_;
};

}  // namespace kinevox
