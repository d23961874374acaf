// The recorder's writing half: holds the latest encoded frame sets, joins them with the pipeline's results
// and appends both to the current recording.
#pragma once

#include <absl/status/status.h>

#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "common/volume.h"
#include "server/recording/encoding_lanes.h"
#include "server/recording/recorder.h"
#include "server/recording/recording_folder.h"

namespace kinevox {

// The pipeline's result of a frame set.
struct ResultOfSet {
    struct Subject {
        std::uint32_t id = 0;
        std::string name;
        std::shared_ptr<const BodyPose> pose;
        std::shared_ptr<const Volume> volume;
        std::shared_ptr<const BodyShape> body;  // see RecordedSubject
    };
    std::uint64_t run = 0, sequence = 0;
    std::vector<Subject> subjects;  // those tracked
};

// One thread.
class RecordingWriter {
  public:
    // `on_failure`: the recording ended with an error, about.end_reason says which.
    RecordingWriter(const RecorderOptions& options,
                    std::function<void(const RecordingInfo& info)> on_failure);

    // In order; a set of a new run empties the rolling buffer.
    void take(std::shared_ptr<const EncodedSet> set);
    void take(ResultOfSet result);
    void set_body(const BodyShape& body);
    void set_background(const std::vector<std::filesystem::path>& videos);

    // From the set of this number on, a key frame.
    void begin(std::unique_ptr<RecordingFolder> folder, std::uint64_t first_number);
    // With the latest `duration_s` of the buffer, 0: all of it.
    void begin_with_buffer(std::unique_ptr<RecordingFolder> folder, double duration_s);
    // The recording as far as it is written; nullopt: there is none.
    std::optional<RecordingInfo> recording(std::uint64_t dropped) const;
    // All written sets have their results.
    bool has_all_results() const;
    RecordingInfo end(std::uint64_t dropped, const std::string& reason);

    // The number after the latest set's.
    std::uint64_t next_number() const { return next_number_; }
    struct Buffered {
        double duration_s = 0;
        std::size_t bytes = 0;
        bool limited_by_memory = false;
    };
    Buffered buffered() const;
    // Frame sets that the current recording lacks, counted by the owner; reported if it fails.
    std::uint64_t dropped = 0;

  private:
    struct Entry {
        std::shared_ptr<const EncodedSet> set;
        std::size_t bytes = 0;
        RecordedResult result;
        bool has_result = false;
        std::optional<std::uint64_t> frame;  // of the current recording
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
    bool limited_by_memory_ = false;
    std::deque<ResultOfSet> results_;  // whose sets are still being encoded
    std::uint64_t run_ = 0, next_number_ = 0;
    std::uint64_t awaited_from_ = 0;  // first sequence whose result is still to come; they come in order
    std::unique_ptr<RecordingFolder> folder_;  // null: no recording
    std::filesystem::path path_;               // of it
    std::uint64_t first_number_ = 0;
    std::chrono::steady_clock::time_point space_checked_{};
};

}  // namespace kinevox
