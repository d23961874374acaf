// Names of a replayed recording's subjects, for those that the replay's own pipeline tracks.
#pragma once

#include <cstdint>
#include <filesystem>
#include <mutex>

#include "server/pipeline/frame_result.h"
#include "server/pipeline/subject_control.h"
#include "server/recording/subject_names.h"

namespace kinevox {

// Thread safe.
class ReplayedNames {
  public:
    // On the control thread; a session without names or with damaged ones has none.
    void open(const std::filesystem::path& session_file);
    void close();
    // On the posing thread, with each result of the replay.
    void observe(const FrameResult& result, SubjectControl& control);

  private:
    std::mutex mutex_;  // guards the following
    RecordedNames recorded_;
    std::uint64_t latest_sequence_ = 0;
};

}  // namespace kinevox
