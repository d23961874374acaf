// The kinds of ProcedureWork and what they share.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "server/calibration/procedure/procedure_work.h"

namespace kinevox {

using ProcedureWorkOr = absl::StatusOr<std::unique_ptr<ProcedureWork>>;

// `chosen`: indices of the participating cameras, increasing.
ProcedureWorkOr make_intrinsics_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                                     const std::vector<std::size_t>& chosen);
ProcedureWorkOr make_board_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                                const std::vector<std::size_t>& chosen);
ProcedureWorkOr make_wand_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                               const std::vector<std::size_t>& chosen);
ProcedureWorkOr make_person_work(const ProcedureRequest& request, const std::vector<Camera>& cameras);

// Checks names, paths and sizes of clips; fills in the sizes.
absl::Status check_clips(const std::vector<Camera>& cameras, std::span<const std::size_t> chosen,
                         ProcedureFiles& files);

// Counts a rejected view; `message` for the operator, empty for the usual case.
void reject_view(CameraObservations& camera, const std::string& why, const std::string& in_words);

}  // namespace kinevox
