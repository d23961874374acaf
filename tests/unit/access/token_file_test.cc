#include "server/access/token_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <fstream>
#include <set>

#include "server/access/audit_log.h"
#include "server/access/call_table.h"
#include "server/access/guard.h"
#include "server/access/private_file.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;
using ::testing::Not;

constexpr std::int64_t kNow = 1'800'000'000, kDay = 86'400;

unsigned mode_of(const std::filesystem::path& file) {
    struct stat found {};
    return ::stat(file.c_str(), &found) == 0 ? found.st_mode & 0777 : 0;
}

class TokenFileTest : public ::testing::Test {
  protected:
    std::string text() const {
        std::ifstream file(file_);
        return {std::istreambuf_iterator<char>(file), {}};
    }
    testing::TemporaryFolder folder_;
    const std::filesystem::path file_ = folder_.path() / "new" / "tokens.toml";
};

TEST(SecretTest, AreRandom256Bits) {
    std::set<std::string> seen;
    for (int i = 0; i < 1000; ++i) {
        const auto secret = make_secret();
        ASSERT_TRUE(secret.ok());
        EXPECT_EQ(secret->size(), 4u + 43u);
        EXPECT_EQ(secret->substr(4).find_first_not_of(
                      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-_"),
                  std::string::npos);
        seen.insert(*secret);
    }
    EXPECT_EQ(seen.size(), 1000u);
}

// FIPS 180-2's example.
TEST(SecretTest, HashesBySha256) {
    EXPECT_EQ(to_hex(sha256("abc")), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
    Digest read;
    ASSERT_TRUE(from_hex(to_hex(sha256("abc")), read));
    EXPECT_TRUE(same(read, sha256("abc")));
    EXPECT_FALSE(same(read, sha256("abd")));
    EXPECT_FALSE(from_hex("ba78", read));
    EXPECT_FALSE(from_hex(std::string(64, 'g'), read));
}

TEST_F(TokenFileTest, StoresHashesForOwnerOnly) {
    const auto token = create_token(file_, {"hall-screen", v1::ROLE_DISPLAY, 90}, kNow);
    ASSERT_TRUE(token.ok()) << token.status();
    EXPECT_EQ(mode_of(file_), 0600u);
    EXPECT_EQ(mode_of(file_.parent_path()), 0700u);
    EXPECT_THAT(text(), Not(HasSubstr(*token)));
    EXPECT_THAT(text(), Not(HasSubstr(token->substr(4))));
    const auto tokens = read_tokens(file_);
    ASSERT_TRUE(tokens.ok()) << tokens.status();
    ASSERT_EQ(tokens->size(), 1u);
    EXPECT_EQ(tokens->front(),
              (Token{"hall-screen", v1::ROLE_DISPLAY, sha256(*token), kNow, kNow + 90 * kDay, 0}));
}

TEST_F(TokenFileTest, AllowsOneValidTokenPerName) {
    ASSERT_TRUE(create_token(file_, {"coach", v1::ROLE_VIEWER, 1}, kNow).ok());
    EXPECT_TRUE(
        absl::IsAlreadyExists(create_token(file_, {"coach", v1::ROLE_OPERATOR, 1}, kNow + 1).status()));
    EXPECT_TRUE(
        create_token(file_, {"coach", v1::ROLE_OPERATOR, 1}, kNow + 2 * kDay).ok());  // the first has expired
    EXPECT_TRUE(revoke_token(file_, "coach", kNow + 2 * kDay).ok());
    EXPECT_TRUE(absl::IsNotFound(revoke_token(file_, "coach", kNow + 2 * kDay)));
    EXPECT_TRUE(absl::IsNotFound(revoke_token(file_, "unknown", kNow)));
    const auto tokens = read_tokens(file_);
    ASSERT_EQ(tokens->size(), 1u);
    EXPECT_FALSE(tokens->front().valid(kNow + 2 * kDay));
}

TEST_F(TokenFileTest, RejectsInvalidNames) {
    for (const char* name : {"", "a b", "a\nb", "a\"b", "../x", "\xff"})
        EXPECT_TRUE(absl::IsInvalidArgument(create_token(file_, {name, v1::ROLE_VIEWER, 1}, kNow).status()))
            << name;
    EXPECT_FALSE(std::filesystem::exists(file_));
}

TEST_F(TokenFileTest, RejectsFileReadableByOthers) {
    ASSERT_TRUE(create_token(file_, {"coach", v1::ROLE_VIEWER, 1}, kNow).ok());
    ::chmod(file_.c_str(), 0640);
    EXPECT_TRUE(absl::IsPermissionDenied(read_tokens(file_).status()));
    EXPECT_TRUE(absl::IsPermissionDenied(Guard::create(file_, {}).status()));
    EXPECT_TRUE(absl::IsPermissionDenied(revoke_token(file_, "coach", kNow)));
}

TEST_F(TokenFileTest, NamesInvalidEntries) {
    const std::string good = to_toml({{"coach", v1::ROLE_VIEWER, sha256("x"), kNow, 0, 0}});
    ASSERT_TRUE(parse_tokens(good, "t").ok());
    const auto with = [&](const std::string& from, const std::string& to) {
        std::string changed = good;
        changed.replace(changed.find(from), from.size(), to);
        return parse_tokens(changed, "t").status();
    };
    EXPECT_THAT(std::string(with("viewer", "king").message()), HasSubstr("viewer, display, operator, admin"));
    EXPECT_TRUE(absl::IsInvalidArgument(with("sha256 = \"", "sha256 = \"00")));
    EXPECT_TRUE(absl::IsInvalidArgument(with("created = \"2027", "created = \"soon")));
    EXPECT_TRUE(absl::IsInvalidArgument(
        with("created", "expires_at")));  // a typing error must not make it last for ever
    EXPECT_TRUE(absl::IsInvalidArgument(with("\"coach\"", "\"\"")));
}

TEST_F(TokenFileTest, KeepsPrivateFilesUnlessForced) {
    ASSERT_TRUE(write_private_file(file_, "one", Existing::kKeep).ok());
    EXPECT_TRUE(absl::IsAlreadyExists(write_private_file(file_, "two", Existing::kKeep)));
    EXPECT_EQ(text(), "one");
    ASSERT_TRUE(write_private_file(file_, "two", Existing::kReplace).ok());
    EXPECT_EQ(text(), "two");
    EXPECT_EQ(mode_of(file_), 0600u);
    int files = 0;
    for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(file_.parent_path()))
        ++files;
    EXPECT_EQ(files, 1);  // no temporary file is left
}

TEST(RolesTest, ConvertToNamesAndBack) {
    for (const char* name : {"viewer", "display", "operator", "admin"})
        EXPECT_EQ(name_of(role_named(name)), name);
    EXPECT_EQ(role_named(""), v1::ROLE_UNSPECIFIED);
    EXPECT_EQ(role_named("unspecified"), v1::ROLE_UNSPECIFIED);
    EXPECT_EQ(role_named("Watch"), v1::ROLE_UNSPECIFIED);
    for (int p = 0; p < 10; ++p) EXPECT_FALSE(has(v1::ROLE_UNSPECIFIED, static_cast<v1::Permission>(p)));
    for (int r = 0; r < 10; ++r) EXPECT_FALSE(has(static_cast<v1::Role>(r), v1::PERMISSION_UNSPECIFIED));
}

}  // namespace
}  // namespace kinevox
