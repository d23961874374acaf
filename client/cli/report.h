// The response of a call, for people or for scripts.
#pragma once

#include <absl/status/status.h>
#include <absl/status/statusor.h>

#include <functional>
#include <string>

#include "client/cli/json.h"
#include "client/cli/verbs.h"

namespace kinevox::cli {

// As JSON with --json, else the text.
template <typename Response>
absl::Status report(const GlobalOptions& global, const absl::StatusOr<Response>& response,
                    const std::function<std::string(const Response&)>& text) {
    if (!response.ok()) return response.status();
    print_line(global.json ? to_json(*response).dump() : text(*response));
    return absl::OkStatus();
}

}  // namespace kinevox::cli
