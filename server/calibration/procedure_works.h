// The kinds of ProcedureWork, each in a file of its own, and what they share.
#pragma once

#include <memory>
#include <span>
#include <string>
#include <vector>

#include "server/calibration/procedure_work.h"

namespace kinevox {

using MadeWork = absl::StatusOr<std::unique_ptr<ProcedureWork>>;

// `chosen`: which of the cameras take part, rising.
MadeWork make_lens_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                        const std::vector<std::size_t>& chosen);
MadeWork make_board_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                         const std::vector<std::size_t>& chosen);
MadeWork make_wand_work(const ProcedureRequest& request, const std::vector<Camera>& cameras,
                        const std::vector<std::size_t>& chosen);
MadeWork make_person_work(const ProcedureRequest& request, const std::vector<Camera>& cameras);

// Names, paths and sizes of clips; fills in the sizes.
absl::Status check_clips(const std::vector<Camera>& cameras, std::span<const std::size_t> chosen,
                         ProcedureFiles& files);

// Counts a view that cannot be used; `in_words` for the operator, empty where that is nothing unusual.
void reject_view(ObservedCamera& camera, const std::string& why, const std::string& in_words);

}  // namespace kinevox
