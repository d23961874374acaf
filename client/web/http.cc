#include "client/web/http.h"

#include <arpa/inet.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <utility>

#include "common/host_port.h"

namespace kinevox::web {
namespace {

namespace fs = std::filesystem;

constexpr std::uintmax_t kMaxTotal_bytes = 64 << 20;
constexpr std::size_t kMaxFiles = 2000;

constexpr std::array<std::pair<std::string_view, const char*>, 13> kTypes{{
    {".html", "text/html; charset=utf-8"},
    {".js", "text/javascript; charset=utf-8"},
    {".css", "text/css; charset=utf-8"},
    {".json", "application/json"},
    {".svg", "image/svg+xml"},
    {".png", "image/png"},
    {".jpg", "image/jpeg"},
    {".webp", "image/webp"},
    {".ico", "image/x-icon"},
    {".woff2", "font/woff2"},
    {".txt", "text/plain; charset=utf-8"},
    {".map", "application/json"},
    {".webmanifest", "application/manifest+json"},
}};

std::string type_of(const fs::path& file) {
    const std::string extension = file.extension().string();
    for (const auto& [ending, type] : kTypes)
        if (extension == ending) return type;
    return "application/octet-stream";
}

std::string etag_of(std::string_view content) {  // FNV-1a: the same in every build
    std::uint64_t hash = 14695981039346656037U;
    for (const char c : content) hash = (hash ^ static_cast<std::uint8_t>(c)) * 1099511628211U;
    return fmt::format("\"{:016x}-{:x}\"", hash, content.size());
}

bool below(const fs::path& file, const fs::path& folder) {
    std::error_code e;
    const fs::path real = fs::canonical(file, e);
    return !e && std::mismatch(folder.begin(), folder.end(), real.begin(), real.end()).first == folder.end();
}

bool hidden(const fs::path& relative) {
    for (const fs::path& part : relative)
        if (part.string().starts_with('.')) return true;
    return false;
}

// The page's own scripts, styles, images and WebSocket only.
constexpr const char* kContentSecurity =
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' blob: data:; font-src 'self'; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'";

std::string lower(std::string text) {
    std::ranges::transform(text, text.begin(), [](unsigned char c) { return std::tolower(c); });
    return text;
}

bool host_allowed(const std::string& host, const HttpRules& rules) {
    const std::string name = lower(host_of(host));
    in_addr v4{};
    in6_addr v6{};
    if (inet_pton(AF_INET, name.c_str(), &v4) == 1 || inet_pton(AF_INET6, name.c_str(), &v6) == 1)
        return true;
    if (name == "localhost") return true;
    return std::ranges::any_of(rules.allowed_hosts,
                               [&](const std::string& allowed) { return lower(allowed) == name; });
}

HttpReply plain(int status, std::string text) {
    HttpReply reply;
    reply.status = status;
    reply.text = std::move(text) + "\n";
    reply.headers = {{"Content-Type", "text/plain; charset=utf-8"},
                     {"Cache-Control", "no-store"},
                     {"X-Content-Type-Options", "nosniff"}};
    return reply;
}

// What is wrong with any request, WebSocket or not.
std::optional<HttpReply> reject(const HttpRequest& request, const HttpRules& rules) {
    if (request.host_count > 1) return plain(400, "more than one Host header");
    if (!host_allowed(request.host, rules))
        return plain(421, fmt::format("Host '{}' is not allowed; allow it with --allow-host",
                                      host_of(request.host).substr(0, 100)));
    return {};
}

}  // namespace

absl::StatusOr<Pages> Pages::read(const fs::path& folder) {
    std::error_code e;
    const fs::path root = fs::canonical(folder, e);
    if (e || !fs::is_directory(root))
        return absl::NotFoundError(
            fmt::format("no folder {}; build the page (docs/exhibit.md) or set --page-dir", folder.string()));
    Pages pages;
    std::uintmax_t bytes = 0;
    for (fs::recursive_directory_iterator at(root, fs::directory_options::skip_permission_denied, e), end;
         at != end; at.increment(e)) {
        if (e) break;
        const fs::path relative = at->path().lexically_relative(root);
        if (!at->is_regular_file(e) || hidden(relative) || !below(at->path(), root)) continue;
        bytes += at->file_size(e);
        if (bytes > kMaxTotal_bytes || pages.size() >= kMaxFiles)
            return absl::InvalidArgumentError(fmt::format(
                "{} has more than 64 MB or {} files; set --page-dir to the folder of a built page",
                root.string(), kMaxFiles));
        std::ifstream in(at->path(), std::ios::binary);
        Page page{{std::istreambuf_iterator<char>(in), {}}, type_of(at->path()), {}, false};
        if (!in) return absl::UnavailableError(fmt::format("cannot read {}", at->path().string()));
        page.etag = etag_of(page.content);
        page.immutable = relative.begin()->string() == "assets";  // Vite puts a hash into these names
        pages.pages_.emplace(fmt::format("/{}", relative.generic_string()), std::move(page));
    }
    if (!pages.find("/"))
        return absl::FailedPreconditionError(
            fmt::format("{} has no index.html; set --page-dir to the folder of a built page", root.string()));
    return pages;
}

const Page* Pages::find(std::string_view target) const {
    const std::string_view path = target.substr(0, target.find_first_of("?#"));
    const auto found = pages_.find(path == "/" ? std::string_view("/index.html") : path);
    return found == pages_.end() ? nullptr : &found->second;
}

HttpReply answer(const HttpRequest& request, const Pages& pages, const HttpRules& rules) {
    if (std::optional<HttpReply> rejection = reject(request, rules)) return *std::move(rejection);
    if (request.method != "GET" && request.method != "HEAD") {
        HttpReply reply = plain(405, "GET and HEAD only");
        reply.headers.emplace_back("Allow", "GET, HEAD");
        return reply;
    }
    if (request.has_body) return plain(400, "requests must not have a body");
    const Page* const page = pages.find(request.target);
    if (!page) return plain(404, "no such file");
    HttpReply reply;
    const bool unchanged =
        !request.if_none_match.empty() &&
        (request.if_none_match == "*" || request.if_none_match.find(page->etag) != std::string::npos);
    reply.status = unchanged ? 304 : 200;
    reply.page = page;
    reply.body = !unchanged && request.method == "GET";
    reply.headers = {{"Content-Type", page->type},
                     {"ETag", page->etag},
                     {"Cache-Control", page->immutable ? "public, max-age=31536000, immutable" : "no-cache"},
                     {"Content-Security-Policy", kContentSecurity},
                     {"X-Content-Type-Options", "nosniff"},
                     {"Referrer-Policy", "no-referrer"},
                     {"Permissions-Policy", "camera=(), microphone=(), geolocation=()"},
                     {"Cross-Origin-Resource-Policy", "same-origin"}};
    return reply;
}

std::optional<HttpReply> reject_socket(const HttpRequest& request, const HttpRules& rules) {
    if (std::optional<HttpReply> rejection = reject(request, rules)) return rejection;
    if (request.has_body) return plain(400, "requests must not have a body");
    if (request.target.substr(0, request.target.find('?')) != "/ws")
        return plain(404, "the WebSocket is at /ws");
    if (request.origin.empty()) return {};  // not a browser: browsers always send Origin
    const std::string origin = lower(request.origin), host = lower(request.host);
    if (origin == "http://" + host || origin == "https://" + host) return {};
    if (std::ranges::any_of(rules.allowed_origins,
                            [&](const std::string& allowed) { return lower(allowed) == origin; }))
        return {};
    return plain(403, "this Origin is not allowed; allow it with --allow-origin");
}

}  // namespace kinevox::web
