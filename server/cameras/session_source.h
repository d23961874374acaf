// Frame sets from the files of a session: videos or folders of images.
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
    // Restarts after the last frame set; sequence and time continue.
    bool loop = false;
    // Maximum number of images decoded ahead per camera; 0: as many as fit into 128 MB, 2 to 32.
    int frames_ahead = 0;
    // True: the decoders fill their queues, then pause until these are empty. This costs no throughput if the
    // pipeline uses all cores, and stage times equal those with live cameras. False: decoding runs in
    // parallel to the processing.
    bool decode_in_bursts = false;
};

// Checks as open_session_files(). The first next() starts a decoding thread per camera; next() returns
// DataLoss where a file is truncated.
//
// The capture time is session time, from 0, with kAsFastAsPossible; steady clock with kRealTime.
absl::StatusOr<std::unique_ptr<FrameSource>> open_session_source(const Session& session,
                                                                 const SessionSourceOptions& options = {});

// read_session() and open_session_source() in one.
absl::StatusOr<std::unique_ptr<FrameSource>> open_session_source(const std::filesystem::path& session_file,
                                                                 const SessionSourceOptions& options = {});

// FrameSource::background(), required of every camera. InvalidArgument names the session and the camera.
absl::StatusOr<std::vector<std::vector<Image>>> background_of_all(FrameSource& source,
                                                                  const std::filesystem::path& session_file);

// Suppresses the messages of OpenCV and FFmpeg about damaged files; our errors report them. Call it in main()
// before any thread starts.
void silence_video_libraries();

}  // namespace kinevox
