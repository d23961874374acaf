// A pose database on disk: one file with a version and a checksum, written aside and renamed.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <filesystem>
#include <string>

#include "server/pose/database/database_builder.h"

namespace kinevox {

absl::Status write_pose_database(const PoseDatabase& database, const std::filesystem::path& file);

// NotFound if there is no such file; DataLoss for one that is damaged, FailedPrecondition for one of another
// version, each with what to do. Never more memory than the file's size asks for.
absl::StatusOr<PoseDatabase> read_pose_database(const std::filesystem::path& file, std::stop_token stop = {});
// Cancelled soon after `stop` says so.
absl::StatusOr<PoseDatabase> parse_pose_database(std::string_view bytes, const std::string& name_for_errors,
                                                 std::stop_token stop = {});
// The file's header for these fields, which follow it: what makes any bytes pass for undamaged.
std::string pose_database_header(std::string_view fields);

struct OpenedDatabase {
    PoseDatabase database;
    std::string rebuilt_because;  // one sentence for the log; empty if the file was as it should be
};

// Reads the file if it was built from the same, else builds and writes it. A user's poses are taken over from
// an older database that can still be read. A file that cannot be written is reported in `rebuilt_because`,
// not as an error.
absl::StatusOr<OpenedDatabase> open_pose_database(const std::filesystem::path& file,
                                                  std::span<const kernels::CameraModel> cameras,
                                                  const BodyShape& shape, const PoseDatabaseOptions& options,
                                                  const BuildProgress& progress = {},
                                                  std::stop_token stop = {});

}  // namespace kinevox
