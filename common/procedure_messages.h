// Messages of calibration procedures that a client compares; part of the API.
#pragma once

namespace kinevox {

// WatchProcedureResponse.message after the files of AddObservations were read; any other one in the state
// COLLECTING says why they were not added.
inline constexpr const char* kFilesReadMessage = "files read";

}  // namespace kinevox
