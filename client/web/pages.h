// The page's files, read once at the start; no other file can be requested.
#pragma once

#include <absl/status/statusor.h>

#include <filesystem>
#include <map>
#include <string>
#include <string_view>

namespace kinevox::web {

struct Page {
    std::string content, type;  // MIME type, with the charset of texts
    std::string etag;           // quoted, of the content
    bool immutable = false;     // its name changes with its content
};

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

}  // namespace kinevox::web
