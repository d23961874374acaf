// Calibrations on disk, and which of them is in use. A folder each (c1, c2, ...) with calibration.toml,
// certificate.json and about.json, written aside and renamed; in_use.json tells for each source which were
// applied one after the other. Sessions and configurations are never written to.
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
    std::string made_by;             // as in Certificate; "import"
    std::optional<Verdict> verdict;  // empty: nobody has judged it
    std::string note;
    std::vector<std::string> cameras;
    bool fits = false;  // has all of the source's cameras at their sizes
};

// Any thread. Several daemons may share a folder.
class CalibrationStore {
  public:
    static constexpr std::size_t kMaxCalibrations = 200;
    static constexpr std::size_t kMaxUndos = 20;

    // `folder` empty: nothing is stored, and what would need it is FailedPrecondition. `source` and the
    // source's own cameras tell whose calibration is in use: a source that gets other cameras, or another
    // calibration of its own, begins anew.
    CalibrationStore(std::filesystem::path folder, std::string source, std::vector<Camera> own_cameras);

    // Oldest first; what cannot be read is left out.
    absl::StatusOr<std::vector<CalibrationListing>> list() const;

    // The new id. ResourceExhausted when the folder is full; Unavailable where it cannot be written.
    absl::StatusOr<std::string> add(const std::vector<Camera>& cameras, const std::string& certificate_json,
                                    const std::string& made_by, std::optional<Verdict> verdict,
                                    const std::string& note, std::int64_t time_utc_ns);
    // FailedPrecondition for one that is in use or to be undone to, by whatever source.
    absl::Status remove(const std::string& id);

    // NotFound for an id that is not there; an empty id is the source's own calibration.
    absl::StatusOr<std::vector<Camera>> cameras(const std::string& id) const;
    std::filesystem::path calibration_file(const std::string& id) const;  // whether it is there or not
    absl::StatusOr<std::string> certificate_json(const std::string& id) const;
    // PNG. Drawn at the first time, by a program of its own, which takes seconds; Unavailable where that
    // fails.
    absl::StatusOr<std::string> certificate_page(const std::string& id) const;
    absl::StatusOr<CalibrationListing> find(const std::string& id) const;

    // The calibration's cameras in the source's order. FailedPrecondition where it does not fit the source.
    absl::StatusOr<std::vector<Camera>> fitting_cameras(const std::string& id) const;

    // Applied one after the other, the newest last; empty: the source's own is in use.
    std::vector<std::string> applied() const;
    std::string in_use() const;
    absl::Status apply(const std::string& id);
    // The id that is in use again, empty for the source's own. FailedPrecondition where nothing is applied.
    absl::StatusOr<std::string> undo();

    const std::vector<Camera>& own_cameras() const { return own_; }

  private:
    absl::Status check_folder() const;
    std::filesystem::path folder_of(const std::string& id) const;
    absl::StatusOr<CalibrationListing> read_about(const std::string& id) const;
    std::vector<std::string> read_applied() const;
    absl::Status write_applied(const std::vector<std::string>& ids) const;

    const std::filesystem::path folder_;
    const std::string key_;  // of the source, in in_use.json
    const std::vector<Camera> own_;
    mutable std::mutex mutex_;  // changes, one after the other
};

}  // namespace kinevox
