// A pose database on disk: one file with a version and a checksum, written atomically.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <string>

#include "server/pose/database/database_builder.h"

namespace kinevox {

absl::Status write_pose_database(const PoseDatabase& database, const std::filesystem::path& file);

// NotFound if there is no such file; DataLoss if it is damaged, FailedPrecondition if it has another version,
// each with the remedy. Memory use is bounded by the file's size.
absl::StatusOr<PoseDatabase> read_pose_database(const std::filesystem::path& file, std::stop_token stop = {});
// Cancelled soon after `stop`.
absl::StatusOr<PoseDatabase> parse_pose_database(std::string_view bytes, const std::string& name_for_errors,
                                                 std::stop_token stop = {});
// The file header for these fields, which follow it, with a valid checksum.
std::string pose_database_header(std::string_view fields);

struct OpenedDatabase {
    PoseDatabase database;
    std::string rebuilt_because;  // one sentence for the log; empty if the file was valid
};

// Reads the file if its fingerprint matches, else builds and writes it. Keeps a user's poses of an older,
// readable database. A file that cannot be written is reported in `rebuilt_because`, not as an error.
absl::StatusOr<OpenedDatabase> open_pose_database(const std::filesystem::path& file,
                                                  std::span<const kernels::CameraModel> cameras,
                                                  const BodyShape& shape, const PoseDatabaseOptions& options,
                                                  const BuildProgress& progress = {},
                                                  std::stop_token stop = {});

}  // namespace kinevox
