// Frame sets from a session's files: videos or folders of pictures.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <vector>

#include "common/session_file.h"
#include "server/cameras/frame_source.h"

namespace kinevox {

struct SessionSourceOptions {
    Pacing pacing = Pacing::kAsFastAsPossible;
    // Starts again behind the last frame set; sequence and time go on.
    bool loop = false;
    // Pictures decoded ahead per camera at most; 0: as many as fit into 128 MB, 2 to 32.
    int frames_ahead = 0;
    // True: the decoders fill their queues, then rest until those are empty. On a machine whose cores are all
    // used by the pipeline this costs no throughput, and stage times are those of a pipeline whose pictures
    // come from cameras. False: decoding goes on beside the processing.
    bool decode_in_bursts = false;
};

// open_session_files() says what is checked. One decoding thread per camera starts with the first next(),
// which gives DataLoss where a file breaks off.
//
// With kAsFastAsPossible the capture time is the recording's own, from 0; with kRealTime the steady clock's.
absl::StatusOr<std::unique_ptr<FrameSource>> open_session_source(const Session& session,
                                                                 const SessionSourceOptions& options = {});

// read_session() and open_session_source() in one.
absl::StatusOr<std::unique_ptr<FrameSource>> open_session_source(const std::filesystem::path& session_file,
                                                                 const SessionSourceOptions& options = {});

// FrameSource::background() where every camera must have one. InvalidArgument names the session and the
// camera.
absl::StatusOr<std::vector<std::vector<Picture>>> background_of_all(
    FrameSource& source, const std::filesystem::path& session_file);

// OpenCV and FFmpeg print their own lines about damaged files; our one line says it better. For main(),
// before any thread starts.
void silence_video_libraries();

}  // namespace kinevox
