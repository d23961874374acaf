// The gateway's HTTP replies and rejections.
#include "client/web/http.h"

#include <gmock/gmock.h>

#include <fstream>

#include "tests/support/temporary_folder.h"

namespace kinevox::web {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

class Http : public ::testing::Test {
  protected:
    Http() {
        fs::create_directories(folder_ / "page/assets");
        write("page/index.html", "<html>");
        write("page/assets/index-1a2b.js", "run()");
        write("page/.secret", "hidden");
        write("outside.txt", "outside");
        fs::create_symlink(folder_ / "outside.txt", folder_ / "page/link.txt");
        pages_ = *Pages::read(folder_ / "page");
    }

    void write(const std::string& name, const std::string& text) { std::ofstream(folder_ / name) << text; }
    HttpReply get(const std::string& target, const std::string& host = "127.0.0.1:8090",
                  const std::string& method = "GET") {
        return answer({method, target, host, "", ""}, pages_, rules_);
    }
    static std::string header(const HttpReply& reply, const std::string& name) {
        for (const auto& [key, value] : reply.headers)
            if (key == name) return value;
        return "";
    }

    const testing::TemporaryFolder temporary_;
    const fs::path folder_ = temporary_.path();
    Pages pages_;
    HttpRules rules_;
};

TEST_F(Http, ServesPageWithTypeAndStrictPolicy) {
    const HttpReply page = get("/?lang=de");
    EXPECT_EQ(page.status, 200);
    ASSERT_TRUE(page.page);
    EXPECT_EQ(page.page->content, "<html>");
    EXPECT_THAT(header(page, "Content-Type"), HasSubstr("text/html"));
    EXPECT_EQ(header(page, "Cache-Control"), "no-cache");
    EXPECT_THAT(header(page, "Content-Security-Policy"), HasSubstr("default-src 'none'"));
    EXPECT_THAT(header(page, "Content-Security-Policy"), ::testing::Not(HasSubstr("unsafe")));
    const HttpReply script = get("/assets/index-1a2b.js");
    EXPECT_THAT(header(script, "Content-Type"), HasSubstr("text/javascript"));
    EXPECT_THAT(header(script, "Cache-Control"), HasSubstr("immutable"));
}

TEST_F(Http, RepliesNotModifiedForMatchingETag) {
    const std::string etag = header(get("/"), "ETag");
    const HttpReply again = answer({"GET", "/", "localhost", "", etag}, pages_, rules_);
    EXPECT_EQ(again.status, 304);
    EXPECT_FALSE(again.body);
    EXPECT_EQ(answer({"GET", "/", "localhost", "", "\"other\""}, pages_, rules_).status, 200);
}

TEST_F(Http, ServesNothingOutsideThePage) {
    for (const char* target : {"/../outside.txt", "/..%2foutside.txt", "/%2e%2e/outside.txt",
                               "/assets/../../outside.txt", "//etc/passwd", "/.secret", "/link.txt",
                               "/assets", "/assets/", "", "http://127.0.0.1/", "/index.html/"})
        EXPECT_EQ(get(target).status, 404) << target;
    EXPECT_EQ(get("/", "127.0.0.1:8090", "POST").status, 405);
    EXPECT_FALSE(get("/", "127.0.0.1:8090", "HEAD").body);
}

TEST_F(Http, RejectsUnknownHosts) {
    for (const char* host : {"127.0.0.1:8090", "localhost", "LOCALHOST:1", "192.168.1.7:8090", "[::1]:8090"})
        EXPECT_EQ(get("/", host).status, 200) << host;
    for (const char* host : {"evil.example", "evil.example:8090", "127.0.0.1.evil.example", "", "[", "[]:80"})
        EXPECT_EQ(get("/", host).status, 421) << host;
    rules_.allowed_hosts = {"Kiosk.Museum"};
    EXPECT_EQ(get("/", "kiosk.museum:8090").status, 200);
}

TEST_F(Http, RejectsDuplicateHosts) {
    HttpRequest request{"GET", "/", "localhost", "", ""};
    EXPECT_EQ(answer(request, pages_, rules_).status, 200);
    request.host_count = 2;
    EXPECT_EQ(answer(request, pages_, rules_).status, 400);
    request.target = "/ws";
    request.upgrade = true;
    ASSERT_TRUE(reject_socket(request, rules_));
    EXPECT_EQ(reject_socket(request, rules_)->status, 400);
}

TEST_F(Http, RejectsBodies) {
    HttpRequest request{"GET", "/", "localhost", "", ""};
    request.has_body = true;
    EXPECT_EQ(answer(request, pages_, rules_).status, 400);
    request.method = "POST";
    EXPECT_EQ(answer(request, pages_, rules_).status, 405);
    request.method = "GET";
    request.target = "/ws";
    ASSERT_TRUE(reject_socket(request, rules_));
    EXPECT_EQ(reject_socket(request, rules_)->status, 400);
}

TEST_F(Http, AcceptsSocketOfOwnOriginOnly) {
    const auto rejected_with = [&](const std::string& origin, const std::string& target = "/ws",
                                   const std::string& host = "127.0.0.1:8090") {
        const auto reply = reject_socket({"GET", target, host, origin, "", true}, rules_);
        return reply ? reply->status : 0;
    };
    EXPECT_EQ(rejected_with("http://127.0.0.1:8090"), 0);
    EXPECT_EQ(rejected_with("https://127.0.0.1:8090"), 0) << "behind a proxy with TLS";
    EXPECT_EQ(rejected_with(""), 0) << "not a browser";
    EXPECT_EQ(rejected_with("http://127.0.0.1:9999"), 403);
    EXPECT_EQ(rejected_with("http://evil.example"), 403);
    EXPECT_EQ(rejected_with("null"), 403);
    EXPECT_EQ(rejected_with("http://evil.example:8090", "/ws", "evil.example:8090"), 421) << "DNS rebinding";
    EXPECT_EQ(rejected_with("http://127.0.0.1:8090", "/other"), 404);
    rules_.allowed_origins = {"http://kiosk.local:8000"};
    EXPECT_EQ(rejected_with("http://kiosk.local:8000"), 0);
}

TEST_F(Http, NamesFolderWithoutPage) {
    EXPECT_THAT(std::string(Pages::read(folder_ / "none").status().message()), HasSubstr("no folder"));
    EXPECT_THAT(std::string(Pages::read(folder_).status().message()), HasSubstr("no index.html"));
}

}  // namespace
}  // namespace kinevox::web
