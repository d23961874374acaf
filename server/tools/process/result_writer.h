// Writes the results of `kinevox process`: tables, and optionally silhouettes and volumes.
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
    int threads = 2;                // compress and write images and volumes
    int max_waiting = 8;            // frame sets not yet written, beyond which add() blocks
};

// Writes into a hidden folder inside the output folder; finish() moves the results to their place, so that
// they are always complete. Used by one thread.
class ResultWriter {
  public:
    static absl::StatusOr<std::unique_ptr<ResultWriter>> create(const std::filesystem::path& folder,
                                                                std::vector<std::string> camera_names,
                                                                const ResultWriterOptions& options = {});
    // Without finish() it removes everything.
    virtual ~ResultWriter() = default;

    // Results in the order of frames. Returns the first error met so far.
    virtual absl::Status add(FrameResultPtr result) = 0;
    // An additional table.
    virtual void add_table(Table table) = 0;
    // Blocks until all is written, then replaces the results of an earlier run.
    virtual absl::Status finish() = 0;
};

}  // namespace kinevox
