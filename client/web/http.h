// Replies to HTTP requests, and the rules that reject them. No sockets.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "client/web/pages.h"

namespace kinevox::web {

struct HttpRequest {
    std::string method, target, host, origin, if_none_match;
    bool upgrade = false;  // to a WebSocket
    int host_count = 1;    // Host headers; more than one is an error
    bool has_body = false;
};

struct HttpReply {
    int status = 200;
    std::vector<std::pair<std::string, std::string>> headers;
    std::string text;  // the body, unless there is a page
    const Page* page = nullptr;
    bool body = true;  // false: HEAD, 304
};

struct HttpRules {
    // Host names accepted in addition to numeric addresses and localhost. Others are rejected: a foreign DNS
    // name that resolves to this machine must not give its pages access to ours (DNS rebinding).
    std::vector<std::string> allowed_hosts;
    std::vector<std::string> allowed_origins;  // may open the WebSocket, in addition to the page's own origin
};

// The reply to any request but a WebSocket upgrade.
HttpReply answer(const HttpRequest& request, const Pages& pages, const HttpRules& rules);
// The reply that rejects a WebSocket upgrade; empty: accepted.
std::optional<HttpReply> reject_socket(const HttpRequest& request, const HttpRules& rules);

}  // namespace kinevox::web
