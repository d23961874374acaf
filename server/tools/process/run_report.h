// What a run of `kinevox process` reports: its provenance in the results folder, its progress and its summary
// on the terminal.
#pragma once

#include <absl/status/statusor.h>

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "common/progress_line.h"
#include "common/stopwatch.h"
#include "server/pipeline/frame_result.h"

namespace kinevox {

struct ProcessOptions;

// Of everything that determines the results: the session's files (session, calibration, videos and
// backgrounds, by name, size, first and last bytes), the T-pose's, the options and the program's version; 16
// hexadecimal digits. The same on every machine, wherever the files are. The errors of read_session().
absl::StatusOr<std::string> run_fingerprint(const ProcessOptions& options);

// run.toml, written last: if it exists, the results are complete.
std::string run_toml(const ProcessOptions& options, const std::string& fingerprint, double fps,
                     std::int64_t frames);

// True if `folder` holds complete results with this fingerprint.
bool holds_results_of(const std::filesystem::path& folder, const std::string& fingerprint);

// Over frame sets: a ProgressLine with the rate and the remaining time.
class ProgressBar {
  public:
    // total < 0: unknown.
    explicit ProgressBar(std::int64_t total, bool quiet);
    void show(std::int64_t done);

  private:
    std::int64_t total_;
    ProgressLine line_;
    Stopwatch running_;
};

// The table at the end.
class RunSummary {
  public:
    void add(const FrameResult& result);
    // Several lines: frames, litres, per stage median and 99th percentile in ms.
    std::string text(double wall_s) const;
    std::int64_t frames() const { return static_cast<std::int64_t>(times_.size()); }

  private:
    std::vector<StageTimes> times_;
    std::vector<double> litres_;
};

}  // namespace kinevox
