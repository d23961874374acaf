// Replies to HTTP requests, the rules that reject them, and the files of the page. No sockets.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace kinevox::web {

struct Page {
    std::string content, type;  // MIME type, with the charset of texts
    std::string etag;           // quoted, of the content
    bool immutable = false;     // its name changes with its content
};

// The page's files, read once at the start; no other file can be requested.
class Pages {
  public:
    // Regular files below `folder`, at most 64 MB and 2000 files, without names that begin with a dot and
    // links out of the folder. FailedPrecondition without an index.html.
    static absl::StatusOr<Pages> read(const std::filesystem::path& folder);

    // By a request's target, "/" or "/assets/index-1a2b.js?x=y"; null if there is no such file.
    const Page* find(std::string_view target) const;
    std::size_t size() const { return pages_.size(); }

  private:
    std::map<std::string, Page, std::less<>> pages_;
};

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
