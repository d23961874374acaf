// Which subject a request means.
#pragma once

#include <absl/status/statusor.h>

#include <cstdint>
#include <vector>

namespace kinevox {

// `requested` 0: the only one of `tracked`, or 0 where there is none. FailedPrecondition: there are several,
// the message names them. NotFound: `requested` is not tracked.
absl::StatusOr<std::uint32_t> choose_subject(std::uint32_t requested,
                                             const std::vector<std::uint32_t>& tracked);

}  // namespace kinevox
