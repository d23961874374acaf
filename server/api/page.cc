#include "server/api/page.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>

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

}  // namespace kinevox
