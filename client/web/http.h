// What the gateway answers to a request, and whom it answers at all. No sockets.
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
};

struct HttpReply {
    int status = 200;
    std::vector<std::pair<std::string, std::string>> headers;
    std::string text;  // the body, where there is no page
    const Page* page = nullptr;
    bool body = true;  // false: HEAD, 304
};

struct HttpRules {
    // Besides addresses in numbers and localhost: a name that somebody else's DNS gives to this machine must
    // not make its pages readers of ours.
    std::vector<std::string> names;
    std::vector<std::string> origins;  // besides the page's own, whose scripts may open the WebSocket
};

// To anything but a WebSocket's beginning.
HttpReply answer(const HttpRequest& request, const Pages& pages, const HttpRules& rules);
// Why a WebSocket is refused; nothing: it may begin.
std::optional<HttpReply> refuse_socket(const HttpRequest& request, const HttpRules& rules);

}  // namespace kinevox::web
