// The rows of the tables that `kinevox process` writes; design: "Contract of the command line".
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "server/pipeline/frame_result.h"
#include "server/recording/table.h"

namespace kinevox {

// Tables that grow by a row (events: by any number of rows) with each result.
//   volume.csv     frame,voxel_mm,voxels,volume_litres,min_x,...,max_z (metres, around the occupied voxels)
//   timing.csv     frame,segmentation_ms,tracking_ms,hull_ms,colouring_ms,pose_ms,total_ms
//   track.csv      frame,time_s,x,y,z,std_m,cameras: G in metres, its standard deviation, how many cameras
//   agreed agreement.csv  frame, then per camera: IoU of the volume's projection and its silhouette, 0..1
//   events.csv     frame,time_s,event,camera,message
// Cells without a value are empty.
class ResultTables {
  public:
    explicit ResultTables(const std::vector<std::string>& camera_names);
    void add(const FrameResult& result);
    const std::vector<Table>& tables() const { return tables_; }

  private:
    std::vector<Table> tables_;
};

std::string_view event_name(EventKind kind);

}  // namespace kinevox
