// The recorder's writing half: holds the newest encoded frame sets, joins them with the pipeline's results
// and appends both to the recording under way.
#pragma once

#include <absl/status/status.h>

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "common/volume.h"
#include "server/recording/encoding_lanes.h"
#include "server/recording/recorder.h"
#include "server/recording/recording_folder.h"

namespace kinevox {

// What the pipeline found in a frame set.
struct ResultOfSet {
    std::uint64_t run = 0, sequence = 0;
    std::shared_ptr<const BodyPose> pose;
    std::shared_ptr<const Volume> volume;
};

// One thread.
class RecordingWriter {
  public:
    // `on_failure`: the recording ended by itself, `about` says why.
    RecordingWriter(const RecorderOptions& options,
                    std::function<void(const RecordingInfo& about)> on_failure);

    // In their order; a set of a new run empties the rolling buffer.
    void take(std::shared_ptr<const EncodedSet> set);
    void take(ResultOfSet result);
    void set_body(const BodyShape& body);
    void set_background(const std::vector<std::filesystem::path>& videos);

    // From the set of this number on, a key.
    void begin(std::unique_ptr<RecordingFolder> folder, std::uint64_t first_number);
    // With what is held: the newest `seconds` of it, 0: all.
    void begin_with_held(std::unique_ptr<RecordingFolder> folder, double seconds);
    // The recording as far as it is written; nothing while there is none.
    std::optional<RecordingInfo> recording(std::uint64_t dropped) const;
    // All results of what was written are written too.
    bool has_all_results() const;
    RecordingInfo end(std::uint64_t dropped, const std::string& reason);

    // The number that follows the newest set.
    std::uint64_t next_number() const { return next_number_; }
    struct Held {
        double seconds = 0;
        std::size_t bytes = 0, sets = 0;
        bool shortened = false;  // by its bound in bytes
    };
    Held held() const;
    std::uint64_t dropped =
        0;  // of the recording under way, as its owner counts; told when it ends by itself

  private:
    struct Entry {
        std::shared_ptr<const EncodedSet> set;
        std::size_t bytes = 0;
        RecordedResult result;
        bool has_result = false;
        std::optional<std::uint64_t> frame;  // of the recording under way
    };
    void write(Entry& entry);
    void join_results();
    void trim();
    absl::Status check_space();
    void fail(const absl::Status& why);
    void check(const absl::Status& written) {
        if (!written.ok()) fail(written);
    }

    const RecorderOptions options_;
    const std::function<void(const RecordingInfo&)> on_failure_;
    std::deque<Entry> entries_;
    std::size_t entries_bytes_ = 0;
    bool shortened_ = false;
    std::deque<ResultOfSet> results_;  // whose sets are still being encoded
    std::uint64_t run_ = 0, next_number_ = 0;
    std::uint64_t awaited_from_ = 0;  // the first sequence whose result is still to come; they come in order
    std::unique_ptr<RecordingFolder> folder_;  // null: no recording
    std::filesystem::path path_;               // of it
    std::uint64_t first_number_ = 0;
    std::chrono::steady_clock::time_point space_checked_{};
};

}  // namespace kinevox
