// What `kinevox process` leaves behind: the tables, and on request silhouettes and volumes.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "server/pipeline/frame_result.h"
#include "server/tools/process/tables.h"

namespace kinevox {

struct ResultWriterOptions {
    bool save_silhouettes = false;  // silhouettes/CAMERA/000000.png, the sharp ones
    bool save_volumes = false;      // volumes/000000.ply
    int threads = 2;                // that compress and write pictures and volumes
    int max_waiting = 8;            // frame sets; add() waits when so many are not yet written
};

// Everything is written into a hidden folder inside the output folder and moved to its place by finish(), so
// that what lies there is always whole. Used by one thread.
class ResultWriter {
  public:
    static absl::StatusOr<std::unique_ptr<ResultWriter>> create(const std::filesystem::path& folder,
                                                                std::vector<std::string> camera_names,
                                                                const ResultWriterOptions& options = {});
    // Without finish() nothing remains of what was added.
    virtual ~ResultWriter() = default;

    // Results in the order of frames. Returns the first error met so far.
    virtual absl::Status add(FrameResultPtr result) = 0;
    // One more table beside those of every run.
    virtual void add_table(Table table) = 0;
    // Waits until all is written, then replaces what an earlier run left in the folder.
    virtual absl::Status finish() = 0;
};

}  // namespace kinevox
