#include <unistd.h>

#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <string>

#include "client/web/http.h"
#include "client/web/subscriptions.h"
#include "common/files.h"
#include "tests/fuzz/fuzz_check.h"

namespace {

using namespace kinevox;

// A page of two files, next to a file that must not be served.
const web::Pages& pages() {
    static const web::Pages kPages = [] {
        char root[] = "/tmp/kinevox-fuzz-web-XXXXXX";
        FUZZ_CHECK(::mkdtemp(root) != nullptr);
        const std::filesystem::path folder = std::filesystem::path(root) / "page";
        FUZZ_CHECK(write_file_atomically(folder / "index.html", "<html></html>").ok());
        FUZZ_CHECK(write_file_atomically(folder / "assets/a-12345678.js", "1").ok());
        FUZZ_CHECK(write_file_atomically(folder / "../secret", "secret").ok());
        auto read = web::Pages::read(folder);
        FUZZ_CHECK(read.ok());
        std::filesystem::remove_all(root);
        return *std::move(read);
    }();
    return kPages;
}

void check_subscriptions(std::string_view bytes) {
    const web::SubscriptionRequest request = web::parse_subscriptions(bytes);
    FUZZ_CHECK(request.accepted.size() + request.errors.size() <=
               static_cast<std::size_t>(web::kMaxSubscriptions));
    FUZZ_CHECK(request.valid || (request.accepted.empty() && request.errors.size() == 1));
    for (const web::Subscription& one : request.accepted) {
        FUZZ_CHECK(one.max_rate_hz == 0 || (one.max_rate_hz >= 0.001 && one.max_rate_hz <= 1000));
        FUZZ_CHECK(one.topic.downsample_level >= 0 && one.topic.downsample_level <= 5);
    }
    for (const web::v1::StreamError& error : request.errors) FUZZ_CHECK(!error.message().empty());
}

// The fields of a request, one per line, in the order of HttpRequest.
web::HttpRequest request_of(std::string_view text) {
    web::HttpRequest request;
    for (std::string* field :
         {&request.method, &request.target, &request.host, &request.origin, &request.if_none_match}) {
        const std::size_t end = std::min(text.find('\n'), text.size());
        *field = text.substr(0, end);
        text.remove_prefix(std::min(end + 1, text.size()));
    }
    return request;
}

void check_http(const web::HttpRequest& request) {
    const web::HttpRules rules{{"exhibit.example"}, {"https://museum.example"}};
    const web::HttpReply reply = web::answer(request, pages(), rules);
    FUZZ_CHECK(reply.status == 200 || reply.status == 304 || reply.status == 404 || reply.status == 405 ||
               reply.status == 421);
    FUZZ_CHECK((reply.status == 200 || reply.status == 304) == (reply.page != nullptr));
    FUZZ_CHECK(!reply.page || reply.page->content != "secret");
    for (const auto& [name, value] : reply.headers)
        FUZZ_CHECK(value.find_first_of("\r\n") == std::string::npos);
    (void)web::reject_socket(request, rules);
}

}  // namespace

// A browser's message, and an HTTP request after parsing by Boost.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    const std::string_view bytes(reinterpret_cast<const char*>(data), size);
    check_subscriptions(bytes);
    check_http(request_of(bytes));
    return 0;
}
