// Calibrations on disk, and which of them is active. One folder each (c1, c2, ...) with calibration.toml,
// certificate.json and calibration.json, written atomically; active.json lists the applied calibrations per
// source. Sessions and configurations are never written.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "common/camera.h"
#include "server/calibration/finding.h"

namespace kinevox {

struct CalibrationListing {
    std::string id;                  // "c7"
    std::int64_t time_utc_ns = 0;    // when it was stored
    std::string method;              // as in Certificate; "import"
    std::optional<Verdict> verdict;  // empty: not checked
    std::string note;
    std::vector<std::string> cameras;
    bool compatible = false;  // has all of the source's cameras at their sizes
};

// Any thread. Several daemons may share a folder.
class CalibrationStore {
  public:
    static constexpr std::size_t kMaxCalibrations = 200;
    static constexpr std::size_t kMaxUndos = 20;

    // An empty `folder` stores nothing: FailedPrecondition. `source` and the source's own cameras identify
    // the list of applied calibrations: a source with other cameras, or another calibration of its own,
    // starts with an empty list.
    CalibrationStore(std::filesystem::path folder, std::string source, std::vector<Camera> own_cameras);

    // Oldest first; unreadable entries are skipped.
    absl::StatusOr<std::vector<CalibrationListing>> list() const;

    // The new id. ResourceExhausted if the folder is full; Unavailable if it cannot be written.
    absl::StatusOr<std::string> add(const std::vector<Camera>& cameras, const std::string& certificate_json,
                                    const std::string& method, std::optional<Verdict> verdict,
                                    const std::string& note, std::int64_t time_utc_ns);
    // Moves it to the bin (common/bin.h). FailedPrecondition if it is active, or an undo would return to it,
    // for any source.
    absl::Status remove(const std::string& id);

    // NotFound for an unknown id; an empty id is the source's own calibration.
    absl::StatusOr<std::vector<Camera>> cameras(const std::string& id) const;
    std::filesystem::path calibration_file(const std::string& id) const;  // whether it exists or not
    absl::StatusOr<std::string> certificate_json(const std::string& id) const;
    // PNG. The first call runs another program, which takes seconds; Unavailable if that fails.
    absl::StatusOr<std::string> certificate_page(const std::string& id) const;
    absl::StatusOr<CalibrationListing> find(const std::string& id) const;

    // The calibration's cameras in the source's order. FailedPrecondition if it is not compatible with the
    // source.
    absl::StatusOr<std::vector<Camera>> compatible_cameras(const std::string& id) const;

    // In the order of application, latest last; empty: the source's own is active.
    std::vector<std::string> applied() const;
    std::string active() const;
    absl::Status apply(const std::string& id);
    // The id that is active again, empty for the source's own. FailedPrecondition if nothing is applied.
    absl::StatusOr<std::string> undo();

    const std::vector<Camera>& own_cameras() const { return own_; }

  private:
    absl::Status check_folder() const;
    std::filesystem::path folder_of(const std::string& id) const;
    absl::StatusOr<CalibrationListing> read_entry(const std::string& id) const;
    std::vector<std::string> read_applied() const;
    absl::Status write_applied(const std::vector<std::string>& ids) const;

    const std::filesystem::path folder_;
    const std::string key_;  // of the source, in active.json
    const std::vector<Camera> own_;
    mutable std::mutex mutex_;  // serialises changes
};

}  // namespace kinevox
