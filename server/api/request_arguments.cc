#include "server/api/request_arguments.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <charconv>
#include <cmath>

namespace kinevox {

absl::StatusOr<Page> page_of(std::size_t count, int page_size, const std::string& page_token) {
    if (page_size < 0)
        return absl::InvalidArgumentError(
            fmt::format("page_size is {}; use a positive number, or 0 for all elements", page_size));
    Page page;
    if (!page_token.empty()) {
        const char* const end = page_token.data() + page_token.size();
        const auto [parsed_end, error] = std::from_chars(page_token.data(), end, page.first);
        if (error != std::errc() || parsed_end != end)
            return absl::InvalidArgumentError(fmt::format(
                "page_token '{}' is invalid; use next_page_token of the previous page, or leave it empty",
                page_token.substr(0, 80)));
    }
    page.first = std::min(page.first, count);  // the list has become shorter since
    page.last = page_size == 0 ? count : std::min(count, page.first + static_cast<std::size_t>(page_size));
    if (page.last < count) page.next_token = std::to_string(page.last);
    return page;
}

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

int level_for(double voxel_m, double max_voxel_m) {
    int level = 0;
    // Tolerates rounding in the client, so that 0.02 / 2 requests 0.01.
    while (level < kMaxLevels && std::ldexp(voxel_m, level + 1) <= max_voxel_m * (1 + 1e-6)) ++level;
    return level;
}

}  // namespace kinevox
