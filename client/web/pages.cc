#include "client/web/pages.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <fstream>
#include <iterator>
#include <utility>

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

}  // namespace kinevox::web
