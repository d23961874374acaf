#include "server/api/subject_choice.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>

namespace kinevox {

absl::StatusOr<std::uint32_t> choose_subject(std::uint32_t requested,
                                             const std::vector<std::uint32_t>& tracked) {
    if (requested != 0) {
        if (std::ranges::find(tracked, requested) != tracked.end()) return requested;
        return absl::NotFoundError(fmt::format(
            "subject {} is not tracked; {}", requested,
            tracked.empty() ? "no subject is" : fmt::format("subjects: {}", fmt::join(tracked, ", "))));
    }
    if (tracked.size() > 1)
        return absl::FailedPreconditionError(fmt::format(
            "several subjects are tracked; set subject_id to one of {}", fmt::join(tracked, ", ")));
    return tracked.empty() ? 0 : tracked.front();
}

}  // namespace kinevox
