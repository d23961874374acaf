// What the fields of a request mean: the page of a list, a subject, a resolution.
#pragma once

#include <absl/status/statusor.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

namespace kinevox {

// Elements [first, last) of a list, in its order. `next_token` is empty on the last page.
struct Page {
    std::size_t first = 0, last = 0;
    std::string next_token;
};

// InvalidArgument: a negative size, or a token that does not belong to a list of `count` elements. Size 0:
// all elements from the token on. A token is the index of the page's first element: elements that are added
// at the end of a list appear on later pages; after a deletion a page may skip one.
absl::StatusOr<Page> page_of(std::size_t count, int page_size, const std::string& page_token);

// The same for a List request.
template <typename Request>
absl::StatusOr<Page> page_of(std::size_t count, const Request& request) {
    return page_of(count, request.page_size(), request.page_token());
}

// `requested` 0: the only one of `tracked`, or 0 where there is none. FailedPrecondition: there are several,
// the message names them. NotFound: `requested` is not tracked.
absl::StatusOr<std::uint32_t> choose_subject(std::uint32_t requested,
                                             const std::vector<std::uint32_t>& tracked);

// Halvings of the resolution that keep an edge of `voxel_m` within `max_voxel_m`; 0 to kMaxLevels.
inline constexpr int kMaxLevels = 5;
int level_for(double voxel_m, double max_voxel_m);

}  // namespace kinevox
